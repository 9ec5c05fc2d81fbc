//! Whatever bytes come, nothing but a documented error comes out, and what is written is read.

use crate::golden_frames::{described_batch, load, load_all};
use bevy_ludus::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchLayout, Call, FrameReader, FrameType, Hello,
    ResetAction, ResetRequest, Spec, Welcome, WireError, encode_frame, read_object,
};
use proptest::prelude::*;
use serde_json::{Value, json};

/// Golden frames with some bytes changed, and cut or prolonged.
fn damaged(kinds: &'static [FrameType]) -> impl Strategy<Value = (usize, Vec<u8>)> {
    let frames = load_all(kinds);
    let count = frames.len();
    let changes = proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6);
    (0..count, changes, -8_isize..8).prop_map(move |(index, changes, longer)| {
        let mut payload = frames[index].payload().to_vec();
        for (place, byte) in changes {
            if !payload.is_empty() {
                let place = place.index(payload.len());
                payload[place] = byte;
            }
        }
        payload.resize(payload.len().saturating_add_signed(longer), 0);
        (index, payload)
    })
}

/// Reads a damaged payload of any JSON frame.
fn read_any(kind: FrameType, payload: &[u8]) -> Result<(), WireError> {
    match kind {
        FrameType::Hello => read_object::<Hello>(payload, "HELLO").map(|_| ()),
        FrameType::Welcome => read_object::<Welcome>(payload, "WELCOME").map(|_| ()),
        FrameType::Call => read_object::<Call>(payload, "CALL").map(|_| ()),
        FrameType::Spec => Spec::decode(payload).map(|_| ()),
        _ => ResetRequest::decode(payload).map(|_| ()),
    }
}

const READ: &[FrameType] = &[
    FrameType::Hello,
    FrameType::Welcome,
    FrameType::Call,
    FrameType::Spec,
    FrameType::Reset,
];

proptest! {
    #[test]
    fn any_stream_is_cut_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let mut reader = FrameReader::default();
        let mut whole = 0;
        match reader.feed(&bytes) {
            Ok(frames) => {
                whole += frames.iter().map(|frame| frame.payload.len() + 8).sum::<usize>();
                prop_assert_eq!(whole + reader.num_pending_bytes(), bytes.len());
            }
            Err(error) => {
                let is_documented = matches!(
                    error,
                    WireError::UnknownType(_)
                        | WireError::Reserved { .. }
                        | WireError::TooLong { .. }
                );
                prop_assert!(is_documented);
            }
        }
    }

    #[test]
    fn frames_survive_any_cut(
        payloads in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..40), 1..5),
        piece in 1_usize..17,
    ) {
        let mut stream = Vec::new();
        for payload in &payloads {
            stream.extend(encode_frame(FrameType::Ping, payload).unwrap());
        }
        let mut reader = FrameReader::default();
        let mut read = Vec::new();
        for part in stream.chunks(piece) {
            read.extend(reader.feed(part).unwrap().into_iter().map(|frame| frame.payload));
        }
        prop_assert_eq!(read, payloads);
    }

    #[test]
    fn damaged_requests_are_read_or_refused((index, payload) in damaged(READ)) {
        let kind = load_all(READ)[index].kind;
        if let Err(error) = read_any(kind, &payload) {
            let is_documented = matches!(
                error,
                WireError::NotJson { .. } | WireError::Malformed { .. } | WireError::Size { .. }
            );
            prop_assert!(is_documented);
        }
    }

    #[test]
    fn damaged_batches_are_read_or_refused((index, payload) in damaged(&[FrameType::Batch])) {
        let golden = &load_all(&[FrameType::Batch])[index];
        let mut frame = BatchFrame::new(BatchLayout::new(&golden.spec()));
        if let Ok(head) = frame.decode(&payload) {
            let written = frame.encode(head).unwrap()[8..].to_vec();
            frame.shorten();
            let mut again = BatchFrame::new(BatchLayout::new(&golden.spec()));
            prop_assert_eq!(again.decode(&written), Ok(head));
            // Header and head are there only in what was written.
            prop_assert_eq!(&again.bytes()[32..], &frame.bytes()[32..]);
            prop_assert_eq!(again.finals, frame.finals);
        }
    }

    #[test]
    fn damaged_steps_are_read_or_refused((index, payload) in damaged(&[FrameType::Step])) {
        let spec = load_all(&[FrameType::Step])[index].spec();
        let mut frame = ActionFrame::new(ActionLayout::new(&spec));
        let is_right = payload.len() == frame.layout().num_bytes;
        prop_assert_eq!(frame.decode(&payload).is_ok(), is_right);
        for (index, policy) in spec.policies.iter().enumerate() {
            let num_agents = policy.num_agents as usize;
            let active: Vec<_> = (0..num_agents).map(|slot| u8::from(slot % 2 == 0)).collect();
            let choices = &frame.layout().policies[index].choices;
            let is_wrong = (0..num_agents).step_by(2).any(|slot| {
                let row = frame.row(index, slot);
                let is_one = |(number, (_, n)): (usize, &(String, u64))| {
                    (0..*n as i64).contains(&row.choice(number))
                };
                !choices.iter().enumerate().all(is_one)
            });
            let checked = frame.check_choices(index, &policy.name, &active);
            prop_assert_eq!(checked.is_err(), is_wrong);
            if let Err(error) = checked {
                let is_malformed = matches!(error, WireError::Malformed { .. });
                prop_assert!(is_malformed);
            }
        }
    }

    #[test]
    fn resets_survive(
        worlds in proptest::collection::vec((any::<u64>(), 0_u8..3), 1..20),
        wind in proptest::option::of(-1.0_f64..1.0),
    ) {
        let action = |number| match number {
            0 => ResetAction::Leave,
            1 => ResetAction::NextEpisode,
            _ => ResetAction::Seed,
        };
        let request = ResetRequest {
            seeds: worlds.iter().map(|(seed, _)| *seed).collect(),
            actions: worlds.iter().map(|(_, number)| action(*number)).collect(),
            parameters: wind.map_or(Value::Null, |wind| json!({ "wind": wind })),
        };
        let frame = request.encode().unwrap();
        prop_assert_eq!(ResetRequest::decode(&frame[8..]), Ok(request));
    }
}

#[test]
fn limits_hold_before_anything_is_allocated() {
    for kind in FrameType::ALL {
        let limit = kind.max_payload_bytes();
        let mut header = [0; 8];
        header[..4].copy_from_slice(&(limit as u32 + 1).to_le_bytes());
        header[4] = kind as u8;
        let error = FrameReader::default().feed(&header).unwrap_err();
        assert_eq!(
            error,
            WireError::TooLong {
                frame: kind,
                bytes: limit + 1,
                limit
            }
        );
    }
}

#[test]
fn final_slots_must_ascend() {
    let golden = load("batch_flat_end");
    let mut frame = described_batch(&golden);
    frame.finals[0].slots.swap(0, 1);
    let bytes = frame.encode(Default::default()).unwrap()[8..].to_vec();
    let mut read = BatchFrame::new(BatchLayout::new(&golden.spec()));
    assert!(
        read.decode(&bytes)
            .unwrap_err()
            .to_string()
            .contains("ascending")
    );
}

/// Changes one value of a valid spec and returns why it is refused.
fn refusal(pointer: &str, value: Value) -> String {
    let mut spec = load("spec_policies").content;
    *spec.pointer_mut(pointer).expect("a place in the spec") = value;
    let text = serde_json::to_vec(&spec).expect("JSON");
    Spec::decode(&text).expect_err("a broken rule").to_string()
}

#[test]
fn a_spec_keeps_every_rule() {
    let broken = [
        ("/num_worlds", json!(65_537), "num_worlds"),
        ("/num_worlds", json!(1), "worlds"),
        ("/ticks_per_step", json!(0), "ticks_per_step"),
        ("/ticks_per_step", json!(1.5), "whole number"),
        ("/tick_rate", json!(-60.0), "tick_rate"),
        ("/layout", json!("scene"), "layout"),
        ("/policies", json!([]), "policies"),
        ("/policies/1/name", json!("hero"), "comes twice"),
        ("/policies/0/name", json!(""), "1 to 128"),
        ("/policies/0/name", json!("x".repeat(129)), "1 to 128"),
        (
            "/policies/1/has_action_mask",
            json!(true),
            "no choice to mask",
        ),
        ("/policies/0/num_agents", json!(3), "agents are listed"),
        ("/policies/0/agents/1/world", json!(0), "expected world 1"),
        (
            "/policies/0/max_episode_steps",
            json!(0),
            "max_episode_steps",
        ),
        ("/policies/0/observation", json!([]), "observation"),
        (
            "/policies/0/observation/1/name",
            json!("aim"),
            "comes twice",
        ),
        (
            "/policies/0/observation/0/shape",
            json!([1, 1, 1, 1, 1, 1, 1, 1, 3]),
            "shape",
        ),
        ("/policies/0/observation/0/shape", json!([0]), "shape"),
        (
            "/policies/0/observation/0/shape",
            json!([4_294_967_296_u64, 4_294_967_296_u64]),
            "shape",
        ),
        (
            "/policies/0/observation/0/low",
            json!([0.0]),
            "expected 3 numbers",
        ),
        (
            "/policies/0/observation/0/low",
            json!([2.0, 0.0, 0.0]),
            "above",
        ),
        ("/policies/0/action/0/n", json!(0), "action[0].n"),
        ("/policies/0/action/1/size", json!(0), "action[1].size"),
        ("/policies/0/action/1/low", json!(3.0), "above"),
    ];
    for (pointer, value, expected) in broken {
        let reason = refusal(pointer, value);
        assert!(reason.contains(expected), "{pointer}: {reason}");
    }
}

#[test]
fn a_spec_whose_batch_is_too_long_is_refused() {
    let reason = refusal("/policies/0/observation/1/shape", json!([1 << 26]));
    assert!(reason.contains("the limit is 268435456"), "{reason}");
}
