//! How long trained policies take to decide, by number of agents.

use bevy_ludus::model::{
    Activation, Distribution, Linear, Memory, MemoryKind, PolicyModel, PolicyNetwork, Tensor,
};
use bevy_ludus::wire::{ActionComponent, ActionKind, DType, ObservationEntry};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use std::hint::black_box;

/// Returns an array of small numbers.
fn tensor(shape: &[usize]) -> Tensor {
    let number = |index| ((index * 7919) % 101) as f32 / 500.0 - 0.1;
    Tensor {
        shape: shape.to_vec(),
        data: (0..shape.iter().product()).map(number).collect(),
    }
}

fn layers(sizes: &[usize], activation: Activation) -> Vec<Linear> {
    let layer = |sizes: &[usize]| Linear {
        weight: tensor(&[sizes[1], sizes[0]]),
        bias: tensor(&sizes[1..]),
        activation,
    };
    sizes.windows(2).map(layer).collect()
}

/// A policy that sees 32 numbers and makes one of four choices.
fn policy(layers: Vec<Linear>, memory: Option<Memory>) -> PolicyModel {
    let entry = ObservationEntry {
        name: "observation".to_owned(),
        dtype: DType::Float32,
        shape: vec![32],
        low: None,
        high: None,
    };
    PolicyModel {
        policy: "hero".to_owned(),
        fingerprint: String::new(),
        observation: vec![entry],
        action: vec![ActionComponent {
            name: "choice".to_owned(),
            kind: ActionKind::Discrete { n: 4 },
        }],
        has_action_mask: false,
        normalisation: None,
        images: Vec::new(),
        memory,
        layers,
        distribution: Distribution {
            log_std: Some(tensor(&[0])),
            log_std_range: [-20.0, 2.0],
            is_squashed: false,
        },
        frames: 1,
    }
}

fn gru(size: usize) -> Memory {
    Memory {
        kind: MemoryKind::Gru,
        weight_input: tensor(&[3 * size, 32]),
        weight_hidden: tensor(&[3 * size, size]),
        bias_input: tensor(&[3 * size]),
        bias_hidden: tensor(&[3 * size]),
    }
}

fn decide(criterion: &mut Criterion) {
    let sizes = [32, 64, 64, 4];
    for (name, model) in [
        (
            "MLP 32-64-64-4, tanh",
            policy(layers(&sizes, Activation::Tanh), None),
        ),
        (
            "MLP 32-64-64-4, relu",
            policy(layers(&sizes, Activation::Relu), None),
        ),
        ("GRU of 64 on 32 inputs, then 64-4", {
            policy(layers(&[64, 4], Activation::None), Some(gru(64)))
        }),
    ] {
        let mut group = criterion.benchmark_group(name);
        for num_agents in [1, 16, 64, 1024] {
            let mut network = PolicyNetwork::new(&model);
            let slots: Vec<_> = (0..num_agents).collect();
            let seen: Vec<u8> = (0..num_agents * 32)
                .flat_map(|index| ((index % 17) as f32 / 17.0).to_le_bytes())
                .collect();
            let mut memory = vec![0.0; network.memory_size() * num_agents];
            group.throughput(Throughput::Elements(num_agents as u64));
            group.bench_function(BenchmarkId::from_parameter(num_agents), |bencher| {
                let row = |_, slot: usize| &seen[slot * 128..(slot + 1) * 128];
                bencher.iter(|| black_box(network.run(row, &slots, &mut memory)).len());
            });
        }
        group.finish();
    }
}

criterion_group!(benches, decide);
criterion_main!(benches);
