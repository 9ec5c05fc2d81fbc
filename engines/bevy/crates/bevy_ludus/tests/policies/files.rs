//! Files for tests: the golden ones, and small ones that are written here.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use std::fs;
use std::path::PathBuf;

/// Names of all golden policies.
pub const NAMES: [&str; 11] = [
    "camera",
    "cameras_with_memory",
    "frames",
    "gru",
    "mixed",
    "perceptron_elu",
    "perceptron_none",
    "perceptron_relu",
    "perceptron_silu",
    "perceptron_tanh",
    "squashed",
];

pub fn folder() -> PathBuf {
    PathBuf::from("tests/golden/policies")
}

/// Returns a golden policy.
pub fn golden(name: &str) -> Vec<u8> {
    fs::read(folder().join(format!("{name}.ludus.json"))).expect("a golden policy")
}

/// Returns a golden policy as JSON.
pub fn golden_json(name: &str) -> Value {
    serde_json::from_slice(&golden(name)).expect("JSON")
}

/// Returns an array as it stands in a file.
pub fn tensor(shape: &[usize], numbers: &[f32]) -> Value {
    let bytes: Vec<_> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    json!({"shape": shape, "data": STANDARD.encode(bytes)})
}

/// Returns a policy of one layer without non-linearity, that sees one vector and makes one choice.
pub fn chooser(num_inputs: usize, weight: &[f32], bias: &[f32]) -> Value {
    let n = bias.len();
    json!({
        "format": "ludus-policy", "version": 1, "policy": "hero", "fingerprint": "",
        "observation": [{"name": "observation", "dtype": "float32", "shape": [num_inputs]}],
        "action": [{"name": "choice", "kind": "discrete", "n": n}],
        "has_action_mask": false, "normalisation": null, "images": [], "memory": null,
        "layers": [{
            "weight": tensor(&[n, num_inputs], weight), "bias": tensor(&[n], bias),
            "activation": "none",
        }],
        "distribution": {"log_std": tensor(&[0], &[]), "log_std_range": [-20.0, 2.0],
            "is_squashed": false},
    })
}

/// Returns the bytes of a file.
pub fn bytes(policy: &Value) -> Vec<u8> {
    serde_json::to_vec(policy).expect("JSON")
}
