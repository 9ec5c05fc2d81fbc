//! The golden frames of `protocol/golden` as values, for all tests of the wire.

use bevy_ludus::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchHead, BatchLayout, DType, FrameType, HEADER_BYTES,
    Spec,
};
use serde_json::Value;
use std::fs;
use std::path::PathBuf;

/// One golden frame.
pub struct Golden {
    /// Name of its files.
    pub name: String,
    /// Its type.
    pub kind: FrameType,
    /// What it carries.
    pub content: Value,
    /// The whole frame.
    pub frame: Vec<u8>,
    /// The token that a `CHALLENGE`, a `PROOF` or a refusal proves.
    pub token: String,
    /// Name of the spec it belongs to.
    pub spec: Option<String>,
}

impl Golden {
    /// Returns the frame without its header.
    pub fn payload(&self) -> &[u8] {
        &self.frame[HEADER_BYTES..]
    }

    /// Returns the spec that the frame belongs to.
    pub fn spec(&self) -> Spec {
        let name = self.spec.as_deref().expect("it belongs to a spec");
        Spec::decode(load(name).payload()).expect("golden specs are valid")
    }
}

fn folder() -> PathBuf {
    PathBuf::from("tests/golden")
}

/// Returns one golden frame.
pub fn load(name: &str) -> Golden {
    let text = fs::read_to_string(folder().join(format!("{name}.json"))).expect("description");
    let described: Value = serde_json::from_str(&text).expect("JSON");
    let kind = described["frame"].as_str().expect("type");
    let is_named = |frame: &&FrameType| frame.to_string() == kind;
    Golden {
        name: name.to_owned(),
        kind: *FrameType::ALL.iter().find(is_named).expect("known type"),
        content: described["content"].clone(),
        token: described["token"].as_str().unwrap_or_default().to_owned(),
        frame: fs::read(folder().join(format!("{name}.bin"))).expect("frame"),
        spec: described["spec"].as_str().map(str::to_owned),
    }
}

/// Returns the golden frames of some types.
pub fn load_all(kinds: &[FrameType]) -> Vec<Golden> {
    let files = fs::read_dir(folder()).expect("golden frames");
    let paths = files.map(|file| file.expect("file").path());
    let mut names: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|suffix| suffix == "bin"))
        .map(|path| {
            path.file_stem()
                .expect("name")
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    names.sort();
    let frames = names.iter().map(|name| load(name));
    let found: Vec<_> = frames
        .filter(|golden| kinds.contains(&golden.kind))
        .collect();
    assert!(!found.is_empty(), "no golden frame of {kinds:?}");
    found
}

/// Returns all numbers of a nested list, as `f64` (exact for golden values).
pub fn flat(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(flat).collect(),
        number => vec![number.as_f64().expect("a number")],
    }
}

/// Returns numbers as bytes of a type.
pub fn to_bytes(dtype: DType, numbers: &[f64]) -> Vec<u8> {
    let write = |number: &f64| match dtype {
        DType::Float32 => (*number as f32).to_le_bytes().to_vec(),
        DType::Uint8 => vec![*number as u8],
        DType::Int64 => (*number as i64).to_le_bytes().to_vec(),
    };
    numbers.iter().flat_map(write).collect()
}

/// Builds a `STEP` from what its description says.
pub fn described_step(golden: &Golden) -> ActionFrame {
    let spec = golden.spec();
    let mut frame = ActionFrame::new(ActionLayout::new(&spec));
    for (index, policy) in spec.policies.iter().enumerate() {
        let content = &golden.content["policies"][&policy.name];
        let choices = flat(&content["discrete"]);
        assert_eq!(frame.discrete_mut(index).len(), choices.len());
        for (bytes, choice) in frame.discrete_mut(index).iter_mut().zip(choices) {
            *bytes = (choice as i64).to_le_bytes();
        }
        let numbers = flat(&content["continuous"]);
        assert_eq!(frame.continuous_mut(index).len(), numbers.len());
        for (bytes, number) in frame.continuous_mut(index).iter_mut().zip(numbers) {
            *bytes = (number as f32).to_le_bytes();
        }
    }
    frame
}

/// Returns the head that a description says.
pub fn described_head(content: &Value) -> BatchHead {
    let number = |key: &str| content[key].as_u64().expect("number");
    let flag = |key: &str| u32::from(content[key].as_bool().expect("flag"));
    BatchHead {
        tick: number("tick"),
        engine_us: number("engine_us") as u32,
        bridge_us: number("bridge_us") as u32,
        wait_us: number("wait_us") as u32,
        flags: flag("is_reset") | flag("has_requests") << 1,
    }
}

/// Builds a `BATCH` from what its description says.
pub fn described_batch(golden: &Golden) -> BatchFrame {
    let spec = golden.spec();
    let mut frame = BatchFrame::new(BatchLayout::new(&spec));
    for (index, policy) in spec.policies.iter().enumerate() {
        let content = &golden.content["policies"][&policy.name];
        let mut arrays: Vec<_> = policy
            .observation
            .iter()
            .map(|entry| to_bytes(entry.dtype, &flat(&content["observation"][&entry.name])))
            .collect();
        arrays.push(to_bytes(DType::Float32, &flat(&content["reward"])));
        let flags = ["terminated", "truncated", "active"];
        arrays.extend(flags.map(|key| to_bytes(DType::Uint8, &flat(&content[key]))));
        if policy.has_action_mask {
            arrays.push(to_bytes(DType::Uint8, &flat(&content["action_mask"])));
        }
        let layouts: Vec<_> = frame.layout().policies[index].all().collect();
        for (bytes, layout) in arrays.iter().zip(layouts) {
            frame.bytes_mut()[layout.start..layout.start + bytes.len()].copy_from_slice(bytes);
        }
        let finals = &mut frame.finals[index];
        finals.slots = flat(&content["final"]["slots"])
            .iter()
            .map(|slot| *slot as u32)
            .collect();
        for (rows, entry) in finals.entries.iter_mut().zip(&policy.observation) {
            let numbers = flat(&content["final"]["observation"][&entry.name]);
            *rows = to_bytes(entry.dtype, &numbers);
        }
    }
    frame
}
