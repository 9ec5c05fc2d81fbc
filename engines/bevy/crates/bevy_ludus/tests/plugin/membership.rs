//! Agents that wait, leave and join, and what they may do.

use crate::game::*;
use crate::trainer::Session;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_ludus::wire::{FrameType, encode_frame};
use serde_json::Value;

#[test]
fn agents_wait_for_their_world() {
    let game = Game {
        plugin: || LudusPlugin::default().episode(EpisodeMode::World),
        agents: 2,
        ..Game::default()
    };
    let mut session = game.open(&worlds(1));
    session.reset(&seeds(0, 1), Value::Null);
    let bytes = session.actions.discrete_mut(0);
    bytes[0] = i64::from(END).to_le_bytes();
    let frame = encode_frame(FrameType::Step, session.actions.payload()).unwrap();
    session.trainer.send(&frame);
    let payload = session.trainer.receive(FrameType::Batch);
    session.batch.decode(&payload).unwrap();
    assert_eq!(session.flags(), [vec![1, 0], vec![0, 0], vec![0, 1]]);
    assert_eq!(
        session.seen(0)[0],
        [0.0; 4],
        "an agent that waits sees zeros"
    );
    session.step(i64::from(END));
    assert_eq!(
        session.flags(),
        [vec![0, 1], vec![0, 0], vec![1, 1]],
        "both begin together"
    );
    assert_eq!(
        session.rewards()[0],
        0.0,
        "an agent that waited has no reward"
    );
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn an_agent_that_leaves_is_reported_once_and_its_world_is_rebuilt() {
    let mut session = Game::default().open(&worlds(2));
    session.reset(&seeds(0, 2), Value::Null);
    session.actions.discrete_mut(0)[1] = i64::from(LEAVE).to_le_bytes();
    let frame = encode_frame(FrameType::Step, session.actions.payload()).unwrap();
    session.trainer.send(&frame);
    let payload = session.trainer.receive(FrameType::Batch);
    session.batch.decode(&payload).unwrap();
    assert_eq!(session.flags(), [vec![0, 1], vec![0, 0], vec![1, 1]]);
    assert_eq!(
        session.finals(0),
        [(1, vec![0.0; 4])],
        "a final observation of zeros"
    );
    session.step(0);
    assert_eq!(session.flags(), [vec![0, 0], vec![0, 0], vec![1, 1]]);
    assert_eq!(
        session.seen(0)[1][0],
        3.0,
        "the world was rebuilt, and plays"
    );
    assert_eq!(session.trainer.close(), AppExit::Success);
}

/// Spawns one agent more in the first tick of an episode.
fn spawn_late(
    worlds: Query<Entity, With<LudusWorld>>,
    counters: Query<&Counter>,
    mut commands: Commands,
) {
    if counters.iter().count() == 1 && counters.iter().all(|counter| counter.ticks == 1.0) {
        for world in &worlds {
            commands.spawn((Agent::of("hero"), InWorld(world), Counter::default()));
        }
    }
}

#[test]
fn an_agent_that_joins_takes_a_spare_slot() {
    let game = Game {
        policy: || Policy::new("hero").spare_slots(1),
        ..Game::default()
    };
    let fill = move |app: &mut App| {
        game.build(app);
        app.add_systems(FixedUpdate, spawn_late.after(count));
    };
    let mut session = Session::open(fill, &worlds(1));
    assert_eq!(session.spec.policies[0].agents[1].path, None);
    session.reset(&seeds(0, 1), Value::Null);
    assert_eq!(session.flags()[2], [1, 0]);
    session.step(0);
    assert_eq!(session.flags(), [vec![0, 0], vec![0, 0], vec![1, 1]]);
    session.step(0);
    assert_eq!((session.seen(0)[1][0], session.rewards()[1]), (3.0, 1.5));
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn masks_are_sent_for_who_acts() {
    let game = Game {
        policy: || Policy::new("hero").with_action_mask(),
        ..Game::default()
    };
    let fill = move |app: &mut App| {
        game.build(app);
        app.add_systems(Observe, |mut masks: Query<&mut ActionMask>| {
            for mut mask in &mut masks {
                mask.0[3] = 0;
            }
        });
    };
    let mut session = Session::open(fill, &worlds(2));
    assert!(session.spec.policies[0].has_action_mask);
    session.reset(&seeds(0, 2), Value::Null);
    assert_eq!(session.masks(), [[1, 1, 1, 0], [1, 1, 1, 0]]);
    assert_eq!(session.trainer.close(), AppExit::Success);
}
