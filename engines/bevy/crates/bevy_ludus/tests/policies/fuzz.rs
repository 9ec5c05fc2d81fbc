//! Whatever bytes come, a policy is read that can be run, or a documented error comes out.

use crate::files::{NAMES, bytes, golden, golden_json, tensor};
use bevy_ludus::model::{ActionHead, PolicyFileError, PolicyModel, PolicyNetwork};
use bevy_ludus::random::RandomStream;
use proptest::prelude::*;
use serde_json::{Value, json};

/// Runs a policy on zeros and on what is largest.
fn run(model: &PolicyModel) {
    let (mut network, head) = (PolicyNetwork::new(model), ActionHead::new(model));
    let mut memory = vec![0.0; network.memory_size() * 2];
    let rows = |byte| {
        let inputs = model.inputs();
        let entries = inputs.iter();
        entries
            .map(|entry| vec![byte; entry.row_bytes()])
            .collect::<Vec<_>>()
    };
    let seen = [rows(0), rows(0x7f)];
    let outputs = network.run(|entry, slot| &seen[slot][entry], &[0, 1], &mut memory);
    let mut random = RandomStream::new(1);
    let mut choices = vec![0; head.num_choices()];
    let mut numbers = vec![0.0; head.num_numbers()];
    for random in [None, Some(&mut random)] {
        head.choose(outputs, &[], random, &mut choices, &mut numbers);
        for (choice, n) in choices.iter().zip(model.choices()) {
            assert!((0..n as i64).contains(choice));
        }
    }
}

proptest! {
    #[test]
    fn any_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
        prop_assert!(PolicyModel::read(&bytes).is_err());
    }

    #[test]
    fn damaged_policies_run_or_are_refused(
        name in proptest::sample::select(&NAMES),
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        shorter in 0_usize..3,
    ) {
        let mut file = golden(name);
        for (place, byte) in changes {
            let place = place.index(file.len());
            file[place] = byte;
        }
        file.truncate(file.len() - shorter.saturating_sub(1));
        if let Ok(model) = PolicyModel::read(&file) {
            run(&model);
        }
    }

    #[test]
    fn altered_values_run_or_are_refused(
        name in proptest::sample::select(&NAMES),
        place in any::<prop::sample::Index>(),
        value in proptest::sample::select(vec![
            json!(null), json!(-1), json!(0), json!(1), json!(2), json!(1.5), json!(1e300),
            json!(4_294_967_296_u64), json!(u64::MAX), json!([]), json!([1, 1]), json!({}),
            json!(""), json!("tanh"), json!(true), json!([[1]]), json!([1e30, -1e30]),
            json!([4_294_967_296_u64, 4_294_967_296_u64]), tensor(&[1], &[f32::MAX]),
        ]),
    ) {
        let mut policy = golden_json(name);
        let mut places = Vec::new();
        list_places(&policy, String::new(), &mut places);
        let pointer: &String = place.get(&places);
        *policy.pointer_mut(pointer).expect("a place") = value;
        if let Ok(model) = PolicyModel::read(&bytes(&policy)) {
            run(&model);
        }
    }
}

fn list_places(value: &Value, place: String, places: &mut Vec<String>) {
    match value {
        Value::Object(object) => {
            for (key, value) in object {
                list_places(value, format!("{place}/{key}"), places);
            }
        }
        Value::Array(items) => {
            for (index, value) in items.iter().enumerate() {
                list_places(value, format!("{place}/{index}"), places);
            }
        }
        _ => {}
    }
    places.push(place);
}

/// Changes one value of a golden policy and returns why it is refused: place and text.
fn refusal(name: &str, pointer: &str, value: Value) -> (String, String) {
    let mut policy = golden_json(name);
    *policy.pointer_mut(pointer).expect("a place") = value;
    let error = PolicyModel::read(&bytes(&policy)).expect_err("a broken rule");
    let text = error.to_string();
    match error {
        PolicyFileError::Malformed { place, .. } => (place, text),
        other => panic!("{other}"),
    }
}

#[test]
fn every_rule_is_kept() {
    let nan = tensor(&[12], &[f32::NAN; 12]);
    let broken = [
        ("mixed", "/format", json!("onnx"), "format"),
        ("mixed", "/version", json!(2), "version"),
        ("mixed", "/policy", json!(""), "policy"),
        ("mixed", "/fingerprint", json!(null), "fingerprint"),
        ("mixed", "/observation", json!([]), "observation"),
        ("mixed", "/observation/1/name", json!("rays"), "observation"),
        (
            "mixed",
            "/observation/0/shape",
            json!([0]),
            "observation[0].shape",
        ),
        (
            "mixed",
            "/observation/0/dtype",
            json!("float64"),
            "observation[0].dtype",
        ),
        (
            "mixed",
            "/observation/0/shape",
            json!([2, 2]),
            "normalisation.shift.shape",
        ),
        ("mixed", "/action", json!([]), "action"),
        ("mixed", "/action/1/n", json!(0), "action[1].n"),
        ("mixed", "/action/1/n", json!(4), "layers[1].bias.shape"),
        ("mixed", "/action/0/low", json!([1.0]), "action[0].low"),
        ("mixed", "/action/0/high", json!(-1.0), "action[0].low"),
        ("mixed", "/action/0/kind", json!("spin"), "action[0].kind"),
        (
            "mixed",
            "/normalisation/limit",
            json!(0.0),
            "normalisation.limit",
        ),
        (
            "mixed",
            "/normalisation/scale",
            tensor(&[1], &[1.0]),
            "normalisation.scale.shape",
        ),
        ("mixed", "/images", json!([1]), "images[0]"),
        ("mixed", "/layers", json!([]), "layers"),
        ("mixed", "/layers/0/bias", nan, "layers[0].bias"),
        ("mixed", "/layers/0/bias/data", json!("!"), "layers[0].bias"),
        (
            "mixed",
            "/layers/0/weight",
            tensor(&[1, 2], &[0.0; 2]),
            "layers[0].weight.shape",
        ),
        (
            "mixed",
            "/layers/0/activation",
            json!("swish"),
            "layers[0].activation",
        ),
        (
            "mixed",
            "/distribution/log_std",
            tensor(&[1], &[0.0]),
            "distribution.log_std.shape",
        ),
        (
            "mixed",
            "/distribution/log_std_range",
            json!([2, 1]),
            "distribution.log_std_range",
        ),
        (
            "mixed",
            "/distribution/is_squashed",
            json!(1),
            "distribution.is_squashed",
        ),
        ("gru", "/memory/kind", json!("lstm"), "memory.kind"),
        (
            "gru",
            "/memory/bias_input",
            tensor(&[1], &[0.0]),
            "memory.bias_input.shape",
        ),
        (
            "gru",
            "/memory/weight_hidden",
            tensor(&[1], &[0.0]),
            "memory.weight_hidden.shape",
        ),
        ("camera", "/images", json!([]), "images"),
        ("camera", "/images/0/entry", json!("ear"), "images"),
        (
            "camera",
            "/images/0/convolutions",
            json!([]),
            "images[0].convolutions",
        ),
        (
            "camera",
            "/images/0/convolutions/0/stride",
            json!(0),
            "images[0].convolutions[0].stride",
        ),
        (
            "camera",
            "/images/0/convolutions/0/padding",
            json!(99),
            "images[0].convolutions[0].padding",
        ),
    ];
    for (name, pointer, value, expected) in broken {
        let (place, text) = refusal(name, pointer, value);
        assert_eq!(place, expected, "{pointer}: {text}");
    }
}

#[test]
fn missing_keys_are_named_and_unknown_ones_passed_over() {
    let whole = golden_json("gru");
    let keys: Vec<_> = whole
        .as_object()
        .expect("an object")
        .keys()
        .cloned()
        .collect();
    assert_eq!(keys.len(), 13);
    for key in keys.into_iter().filter(|key| key != "frames") {
        let mut policy = whole.clone();
        policy.as_object_mut().expect("an object").remove(&key);
        let error = PolicyModel::read(&bytes(&policy)).expect_err("a missing key");
        assert!(
            error.to_string().contains(&format!("`{key}`")),
            "{key}: {error}"
        );
    }
    let mut policy = whole;
    policy.as_object_mut().expect("an object").remove("frames");
    policy["mood"] = json!({"is": ["good"]});
    policy["layers"][0]["mood"] = json!(1);
    assert!(PolicyModel::read(&bytes(&policy)).is_ok());
}

#[test]
fn long_lists_are_refused_before_they_fill_the_memory() {
    let whole = golden_json("gru");
    for (pointer, item) in [
        ("/observation", whole["observation"][0].clone()),
        ("/action", whole["action"][0].clone()),
        ("/layers", whole["layers"][0].clone()),
        ("/observation/0/shape", json!(1)),
        ("/layers/0/bias/shape", json!(1)),
    ] {
        let mut policy = whole.clone();
        *policy.pointer_mut(pointer).expect("a place") = vec![item; 1000].into();
        let error = PolicyModel::read(&bytes(&policy)).expect_err("too long a list");
        assert!(
            error.to_string().contains("invalid length"),
            "{pointer}: {error}"
        );
    }
    let mut policy = whole;
    policy["mood"] = vec![json!([[[]]]); 100_000].into();
    assert!(PolicyModel::read(&bytes(&policy)).is_ok());
    policy["layers"][0]["bias"]["shape"] = json!([1 << 13, 1 << 13]);
    let error = PolicyModel::read(&bytes(&policy)).expect_err("too many numbers");
    assert!(
        error.to_string().contains("is more than 33554432 numbers"),
        "{error}"
    );
}

#[test]
fn what_is_no_object_is_refused() {
    for text in [
        "",
        "  ",
        "[]",
        "null",
        "{",
        "{} {}",
        "[\"ludus-policy\", 1]",
    ] {
        assert!(PolicyModel::read(text.as_bytes()).is_err(), "{text}");
    }
    let error = PolicyModel::load("/no/such/policy".as_ref()).expect_err("no file");
    assert!(
        error
            .to_string()
            .starts_with("cannot read /no/such/policy: ")
    );
}
