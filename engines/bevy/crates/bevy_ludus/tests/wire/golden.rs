//! Rust reads and writes every golden frame.

use crate::golden_frames::{described_batch, described_head, described_step, load_all};
use bevy_ludus::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchLayout, Call, CallResult, Challenge, ErrorReport,
    FrameReader, FrameType, Hello, Proof, ResetAction, ResetRequest, Spec, Welcome, decode_json,
    encode_frame, encode_json, read_object,
};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

const JSON_FRAMES: [FrameType; 8] = [
    FrameType::Hello,
    FrameType::Welcome,
    FrameType::Spec,
    FrameType::Call,
    FrameType::Result,
    FrameType::Error,
    FrameType::Challenge,
    FrameType::Proof,
];

#[test]
fn every_type_has_a_golden_frame() {
    for kind in FrameType::ALL {
        load_all(&[kind]);
    }
}

#[test]
fn frames_are_cut_out_of_a_stream_fed_a_byte_at_a_time() {
    let all = load_all(&FrameType::ALL);
    let mut reader = FrameReader::default();
    let mut frames = Vec::new();
    for byte in all.iter().flat_map(|golden| &golden.frame) {
        frames.extend(reader.feed(&[*byte]).unwrap());
    }
    assert_eq!(reader.num_pending_bytes(), 0);
    assert_eq!(frames.len(), all.len());
    for (frame, golden) in frames.iter().zip(&all) {
        assert_eq!(
            (frame.kind, frame.payload.as_slice()),
            (golden.kind, golden.payload())
        );
        assert_eq!(
            encode_frame(frame.kind, &frame.payload).unwrap(),
            golden.frame
        );
    }
}

#[test]
fn json_is_read_and_written() {
    for golden in load_all(&JSON_FRAMES) {
        let object = Value::Object(decode_json(golden.payload(), &golden.name).unwrap());
        assert_eq!(object, golden.content, "{}", golden.name);
        let written = encode_json(golden.kind, &object).unwrap();
        let again = decode_json(&written[8..], &golden.name).unwrap();
        assert_eq!(Value::Object(again), golden.content, "{}", golden.name);
    }
}

/// Checks that a type says all that the golden frames of a kind say, but for the named keys, which
/// this version does not know.
fn is_whole<T: DeserializeOwned + Serialize>(kind: FrameType, unknown: &[&str]) {
    for golden in load_all(&[kind]) {
        let value: T = read_object(golden.payload(), &golden.name).expect("a valid frame");
        let mut written = serde_json::to_value(value).expect("JSON");
        for key in unknown {
            if let Some(content) = golden.content.get(key) {
                written[key] = content.clone();
            }
        }
        assert_eq!(
            with_floats(&written),
            with_floats(&golden.content),
            "{}",
            golden.name
        );
    }
}

/// Spells all numbers alike: `60` as `60.0`.
fn with_floats(value: &Value) -> Value {
    match value {
        Value::Number(number) => json!(number.as_f64()),
        Value::Array(items) => items.iter().map(with_floats).collect(),
        Value::Object(object) => object
            .iter()
            .map(|(key, value)| (key.clone(), with_floats(value)))
            .collect(),
        other => other.clone(),
    }
}

#[test]
fn hello_is_whole() {
    is_whole::<Hello>(FrameType::Hello, &["mood", "token"]);
}

#[test]
fn challenge_and_proof_are_whole() {
    is_whole::<Challenge>(FrameType::Challenge, &[]);
    is_whole::<Proof>(FrameType::Proof, &[]);
}

#[cfg(feature = "trainer")]
#[test]
fn proofs_are_made_and_checked() {
    use bevy_ludus::wire::{NONCE_BYTES, Role, from_hex, is_proof, make_proof, to_hex};
    let nonce = |name: &str| {
        let content = crate::golden_frames::load(name).content;
        from_hex(content["nonce"].as_str().unwrap()).unwrap()
    };
    let (ours, theirs) = (nonce("hello"), nonce("challenge"));
    for name in ["challenge", "error_refused", "proof"] {
        let golden = crate::golden_frames::load(name);
        let (role, other) = match golden.kind {
            FrameType::Proof => (Role::Engine, Role::Trainer),
            _ => (Role::Trainer, Role::Engine),
        };
        let proof = make_proof(&golden.token, role, &ours, &theirs);
        assert_eq!(golden.content["proof"], to_hex(&proof), "{}", golden.name);
        assert!(is_proof(&proof, &golden.token, role, &ours, &theirs));
        assert!(!is_proof(&proof, &golden.token, other, &ours, &theirs));
        assert!(!is_proof(&proof, "another token", role, &ours, &theirs));
        assert!(!is_proof(&proof, &golden.token, role, &theirs, &ours));
        assert!(!is_proof(
            &[0; NONCE_BYTES],
            &golden.token,
            role,
            &ours,
            &theirs
        ));
    }
    for text in [
        "",
        "0",
        &"0".repeat(62),
        &"0".repeat(66),
        &"g".repeat(64),
        &"+f".repeat(32),
    ] {
        assert_eq!(from_hex(text), None, "{text}");
    }
}

#[test]
fn welcome_is_whole() {
    is_whole::<Welcome>(FrameType::Welcome, &[]);
}

#[test]
fn spec_is_whole_and_valid() {
    is_whole::<Spec>(FrameType::Spec, &[]);
    for golden in load_all(&[FrameType::Spec]) {
        Spec::decode(golden.payload()).unwrap();
    }
}

#[test]
fn call_is_whole() {
    is_whole::<Call>(FrameType::Call, &[]);
}

#[test]
fn result_is_whole() {
    is_whole::<CallResult>(FrameType::Result, &[]);
}

#[test]
fn error_is_whole() {
    is_whole::<ErrorReport>(FrameType::Error, &["nonce", "proof"]);
}

#[test]
fn reset_is_read_and_written() {
    for golden in load_all(&[FrameType::Reset]) {
        let request = ResetRequest::decode(golden.payload()).unwrap();
        let seeds: Vec<_> = request
            .seeds
            .iter()
            .map(|seed| format!("{seed:016x}"))
            .collect();
        assert_eq!(json!(seeds), golden.content["seeds"]);
        let actions: Vec<_> = request.actions.iter().map(|action| *action as u8).collect();
        assert_eq!(json!(actions), golden.content["actions"]);
        assert_eq!(request.parameters, golden.content["parameters"]);
        assert_eq!(request.encode().unwrap(), golden.frame, "{}", golden.name);
    }
}

#[test]
fn reset_tells_what_each_world_gets() {
    let frames = load_all(&[FrameType::Reset]);
    let list = frames
        .iter()
        .find(|golden| golden.name == "reset_list")
        .unwrap();
    let request = ResetRequest::decode(list.payload()).unwrap();
    assert_eq!(request.actions[2], ResetAction::NextEpisode);
    assert!(!request.is_seeding_all());
    assert_eq!(request.parameters_of(1), &json!({"wind": 0.5}));
    assert_eq!(request.parameters_of(2), &Value::Null);
}

#[test]
fn step_is_read_and_written() {
    for golden in load_all(&[FrameType::Step]) {
        let described = described_step(&golden);
        let mut read = ActionFrame::new(ActionLayout::new(&golden.spec()));
        read.decode(golden.payload()).unwrap();
        assert_eq!(read, described, "{}", golden.name);
        let written = encode_frame(FrameType::Step, described.payload()).unwrap();
        assert_eq!(written, golden.frame, "{}", golden.name);
    }
}

#[test]
fn actions_are_read_slot_by_slot() {
    let frames = load_all(&[FrameType::Step]);
    let golden = frames
        .iter()
        .find(|golden| golden.name == "step_policies")
        .unwrap();
    let frame = described_step(golden);
    let hero = frame.row(0, 0);
    assert_eq!(
        (hero.choice(0), hero.number(0), hero.number(2)),
        (3, -1.0, 0.125)
    );
    assert_eq!(
        (hero.choice(1), hero.number(3)),
        (0, 0.0),
        "what is not there is zero"
    );
    assert_eq!(frame.row(1, 3).number(0), 1.5);
}

#[test]
fn batch_is_read_and_written() {
    for golden in load_all(&[FrameType::Batch]) {
        let mut described = described_batch(&golden);
        let head = described_head(&golden.content);
        let mut read = BatchFrame::new(BatchLayout::new(&golden.spec()));
        assert_eq!(read.decode(golden.payload()).unwrap(), head);
        assert_eq!(read, described, "{}", golden.name);
        assert_eq!(
            described.encode(head).unwrap(),
            golden.frame,
            "{}",
            golden.name
        );
        described.shorten();
        assert_eq!(
            described.encode(head).unwrap(),
            golden.frame,
            "{}: again",
            golden.name
        );
    }
}
