//! Rust computes every golden policy (POLICY.md §6).

use crate::files::{NAMES, folder, golden};
use bevy_ludus::model::{ActionHead, PolicyFrames, PolicyModel, PolicyNetwork};
use bevy_ludus::wire::DType;
use serde_json::Value;
use std::fs;

const TOLERANCE: f64 = 1e-5;

/// Returns a flat row of numbers.
fn numbers(row: &Value) -> Vec<f64> {
    let row = row.as_array().expect("a row").iter();
    row.map(|number| number.as_f64().expect("a number"))
        .collect()
}

/// Returns rows as the bytes of an entry.
fn encode(dtype: DType, rows: &Value) -> Vec<Vec<u8>> {
    let encode_one = |x: f64| match dtype {
        DType::Float32 => (x as f32).to_le_bytes().to_vec(),
        DType::Uint8 => vec![x as u8],
        DType::Int64 => (x as i64).to_le_bytes().to_vec(),
    };
    let rows = rows.as_array().expect("rows").iter();
    rows.map(|row| numbers(row).into_iter().flat_map(encode_one).collect())
        .collect()
}

fn assert_near(name: &str, found: &[f32], expected: &Value) {
    let expected = numbers(expected);
    assert_eq!(found.len(), expected.len(), "{name}");
    for (found, expected) in found.iter().zip(expected) {
        let error = (f64::from(*found) - expected).abs() / expected.abs().max(1.0);
        assert!(error <= TOLERANCE, "{name}: {found} is not {expected}");
    }
}

/// Plays all steps of a golden policy with the agents of some slots.
fn check(name: &str, slots: &[usize]) {
    let model = PolicyModel::read(&golden(name)).expect("a valid policy");
    assert_eq!(model.policy, name);
    let text = fs::read_to_string(folder().join(format!("{name}.cases.json"))).expect("cases");
    let cases: Value = serde_json::from_str(&text).expect("JSON");
    let num_agents = cases["num_agents"].as_u64().expect("a number") as usize;
    let (mut network, head) = (PolicyNetwork::new(&model), ActionHead::new(&model));
    let size = network.memory_size();
    let mut memory = vec![0.5; size * num_agents];
    let mut frames = PolicyFrames::new(&model, num_agents);
    for step in cases["steps"].as_array().expect("steps") {
        for slot in step["begins"].as_array().expect("slots") {
            let slot = slot.as_u64().expect("a slot") as usize;
            memory[slot * size..(slot + 1) * size].fill(0.0);
            frames.begin(slot);
        }
        let rows = |entry: &bevy_ludus::wire::ObservationEntry| {
            encode(entry.dtype, &step["observation"][&entry.name])
        };
        let seen: Vec<_> = model.observation.iter().map(rows).collect();
        frames.push(|entry, slot| seen[entry][slot].as_slice(), slots);
        let row = |entry: usize, slot: usize| frames.row(entry, slot);
        let outputs = network.run(row, slots, &mut memory).to_vec();
        let width = outputs.len() / slots.len();
        for (outputs, slot) in outputs.chunks(width).zip(slots.iter().copied()) {
            assert_near(name, outputs, &step["outputs"][slot]);
            if size > 0 {
                let state = &memory[slot * size..(slot + 1) * size];
                assert_near(name, state, &step["memory"][slot]);
            }
            let mask: Vec<_> = match &step["action_mask"] {
                Value::Null => Vec::new(),
                mask => numbers(&mask[slot])
                    .iter()
                    .map(|byte| *byte as u8)
                    .collect(),
            };
            let mut choices = vec![-1; head.num_choices()];
            let mut decided = vec![f32::NAN; head.num_numbers()];
            head.choose(outputs, &mask, None, &mut choices, &mut decided);
            let expected = numbers(&step["discrete"][slot]);
            let choices: Vec<_> = choices.iter().map(|choice| *choice as f64).collect();
            assert_eq!(choices, expected, "{name}");
            assert_near(name, &decided, &step["continuous"][slot]);
        }
    }
}

#[test]
fn every_golden_policy_is_there() {
    let files = fs::read_dir(folder()).expect("golden policies");
    let count = files
        .map(|file| file.expect("a file").file_name())
        .filter(|name| name.to_string_lossy().ends_with(".ludus.json"))
        .count();
    assert_eq!(count, NAMES.len());
}

#[test]
fn golden_policies_come_out_right() {
    for name in NAMES {
        check(name, &[0, 1, 2, 3, 4]);
    }
}

#[test]
fn agents_do_not_depend_on_who_else_is_computed() {
    for name in NAMES {
        check(name, &[3]);
        check(name, &[4, 1]);
        check(name, &[2, 0, 3]);
    }
}

#[test]
fn many_agents_are_computed_as_few() {
    let model = PolicyModel::read(&golden("gru")).expect("a valid policy");
    let mut network = PolicyNetwork::new(&model);
    let size = network.memory_size();
    let num_bytes = model.observation[0].row_bytes();
    let rows: Vec<Vec<u8>> = (0..150_u32)
        .map(|slot| {
            let number = |element: u32| ((slot * 7 + element * 3) % 11) as f32 * 0.2 - 1.0;
            (0..num_bytes as u32 / 4)
                .flat_map(|element| number(element).to_le_bytes())
                .collect()
        })
        .collect();
    let all: Vec<_> = (0..rows.len()).collect();
    let mut memory = vec![0.0; size * rows.len()];
    let together = network
        .run(|_, slot| &rows[slot], &all, &mut memory)
        .to_vec();
    let mut alone = vec![0.0; size * rows.len()];
    for slot in all {
        let width = network.num_outputs();
        let outputs = network.run(|_, slot| &rows[slot], &[slot], &mut alone);
        assert_eq!(outputs, &together[slot * width..(slot + 1) * width]);
    }
    assert_eq!(memory, alone);
}
