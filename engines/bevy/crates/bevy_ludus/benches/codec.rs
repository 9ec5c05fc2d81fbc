//! How long the wire takes: one `STEP` in and one `BATCH` out, by number of agents.

use bevy_ludus::wire::{
    ActionFrame, ActionLayout, AgentSpec, BatchFrame, BatchHead, BatchLayout, FrameReader,
    FrameType, Spec, encode_frame,
};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use serde_json::json;
use std::hint::black_box;

/// One policy that sees four numbers and chooses one of two.
fn spec(num_agents: u64) -> Spec {
    let agents: Vec<_> = (0..num_agents)
        .map(|world| AgentSpec { world, path: None })
        .collect();
    let value = json!({
        "num_worlds": num_agents, "layout": "grid", "ticks_per_step": 2, "tick_rate": 60.0,
        "policies": [{
            "name": "cart", "num_agents": num_agents, "agents_per_world": 1, "episode": "agent",
            "max_episode_steps": 250, "has_action_mask": false, "agents": agents, "settings": {},
            "observation": [{"name": "observation", "dtype": "float32", "shape": [4]}],
            "action": [{"name": "push", "kind": "discrete", "n": 2}],
        }],
    });
    serde_json::from_value(value).expect("a spec")
}

fn step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("STEP, decoded and read");
    for num_agents in [64, 1024, 4096] {
        let mut frame = ActionFrame::new(ActionLayout::new(&spec(num_agents)));
        let payload = frame.payload().to_vec();
        let active = vec![1; num_agents as usize];
        group.throughput(Throughput::Elements(num_agents));
        group.bench_function(BenchmarkId::from_parameter(num_agents), |bencher| {
            bencher.iter(|| {
                frame.decode(black_box(&payload)).expect("a STEP");
                frame.check_choices(0, "cart", &active).expect("choices");
                (0..num_agents as usize)
                    .map(|slot| frame.row(0, slot).choice(0))
                    .sum::<i64>()
            });
        });
    }
    group.finish();
}

fn batch(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("BATCH, written and encoded");
    for num_agents in [64, 1024, 4096] {
        let mut frame = BatchFrame::new(BatchLayout::new(&spec(num_agents)));
        group.throughput(Throughput::Elements(num_agents));
        group.bench_function(BenchmarkId::from_parameter(num_agents), |bencher| {
            bencher.iter(|| {
                frame.finals[0].clear();
                for slot in 0..num_agents as usize {
                    let row = frame.layout().policies[0].entries[0].row(slot);
                    frame.bytes_mut()[row].copy_from_slice(&black_box([7; 16]));
                }
                // One agent in fifty ends its episode.
                for slot in (0..num_agents as usize).step_by(50) {
                    frame.keep_final(0, slot);
                }
                black_box(frame.encode(BatchHead::default()).expect("a BATCH"));
                frame.shorten();
            });
        });
    }
    group.finish();
}

fn stream(criterion: &mut Criterion) {
    let frame = encode_frame(FrameType::Ping, &[7; 4096]).expect("a frame");
    criterion.bench_function("a stream cut into frames, 4 KiB", |bencher| {
        let mut reader = FrameReader::default();
        bencher.iter(|| reader.feed(black_box(&frame)).expect("a frame").len());
    });
}

criterion_group!(benches, step, batch, stream);
criterion_main!(benches);
