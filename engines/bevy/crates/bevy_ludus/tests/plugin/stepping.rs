//! Steps, episodes, seeds, layouts and resets.

use crate::game::*;
use bevy_app::prelude::*;
use bevy_ludus::prelude::*;
use bevy_ludus::wire::{ResetAction, ResetRequest};
use serde_json::{Value, json};

#[test]
fn the_game_is_described() {
    let session = Game {
        agents: 2,
        ..Game::default()
    }
    .open(&worlds(2));
    let hello = &session.trainer.hello;
    assert_eq!(
        (hello.engine.name.as_str(), hello.protocol.max),
        ("bevy", 2)
    );
    let spec = &session.spec;
    assert_eq!(
        (spec.num_worlds, spec.ticks_per_step, spec.scene.as_str()),
        (2, 3, "counter")
    );
    assert_eq!((spec.layout, spec.tick_rate), (WorldLayout::Grid, 64.0));
    let policy = &spec.policies[0];
    assert_eq!((policy.num_agents, policy.agents_per_world), (4, 2));
    assert_eq!(policy.max_episode_steps, Some(10));
    let worlds: Vec<_> = policy.agents.iter().map(|agent| agent.world).collect();
    assert_eq!(worlds, [0, 0, 1, 1]);
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn a_step_is_exactly_its_ticks() {
    let mut session = Game::default().open(&worlds(2));
    let head = session.reset(&seeds(0, 2), Value::Null);
    assert_eq!((head.tick, head.flags), (0, 1));
    assert_eq!(session.flags(), [vec![0, 0], vec![0, 0], vec![1, 1]]);
    for step in 1..=4 {
        let head = session.step(0);
        assert_eq!((head.tick, head.flags), (3 * step, 0));
        assert_eq!(session.seen(0)[1][0], 3.0 * step as f32);
        assert_eq!(session.rewards(), [1.5, 1.5]);
    }
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn the_trainer_may_choose_ticks_and_length() {
    let config = json!({"num_worlds": 1, "ticks_per_step": 40, "max_episode_steps": 2});
    let mut session = Game::default().open(&config);
    assert_eq!(session.spec.ticks_per_step, 40);
    assert_eq!(session.spec.policies[0].max_episode_steps, Some(2));
    session.reset(&seeds(0, 1), Value::Null);
    assert_eq!((session.step(0).tick, session.seen(0)[0][0]), (40, 40.0));
    session.step(0);
    assert_eq!(
        session.flags(),
        [vec![0], vec![1], vec![1]],
        "truncated, and begun again"
    );
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn an_end_carries_both_episodes() {
    let mut session = Game::default().open(&worlds(2));
    session.reset(&seeds(5, 2), Value::Null);
    let first = session.seen(0)[0][1];
    session.step(0);
    session.step(i64::from(END));
    assert_eq!(session.flags(), [vec![1, 1], vec![0, 0], vec![1, 1]]);
    assert_eq!(
        session.rewards(),
        [1.5, 1.5],
        "the reward belongs to the old episode"
    );
    assert_eq!(session.finals(0)[0], (0, vec![6.0, first, 1.0, 0.25]));
    let begun = &session.seen(0)[0];
    assert_eq!(
        begun[0], 0.0,
        "the observation is the first of the new episode"
    );
    assert_ne!(begun[1], first, "the random stream has gone on");
    session.step(i64::from(CUT));
    assert_eq!(session.flags(), [vec![0, 0], vec![1, 1], vec![1, 1]]);
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn equal_seeds_give_equal_bits() {
    let mut session = Game::default().open(&worlds(3));
    let first = record(&mut session, 1);
    assert_ne!(record(&mut session, 2), first);
    assert_eq!(record(&mut session, 1), first);
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[test]
fn isolated_worlds_play_as_worlds_side_by_side() {
    let game = divisible();
    let mut isolated = game.open(&worlds(5));
    assert_eq!(isolated.spec.layout, WorldLayout::Isolated);
    let mut grid = game.open(&json!({"num_worlds": 5, "layout": "grid"}));
    assert_eq!(grid.spec.policies, isolated.spec.policies);
    let recorded = record(&mut grid, 3);
    assert_eq!(record(&mut isolated, 3), recorded);
    assert_eq!(record(&mut isolated, 3), recorded, "and once more");
    let mut single = game.open(&worlds(1));
    let alone = record(&mut single, 5);
    let third: Vec<_> = recorded.iter().map(|rows| vec![rows[2].clone()]).collect();
    assert_eq!(alone, third, "world 2 equals a world alone with its seed");
    for session in [isolated, grid, single] {
        assert_eq!(session.trainer.close(), AppExit::Success);
    }
}

#[test]
fn some_worlds_are_reset_and_others_stand() {
    for game in [Game::default(), divisible()] {
        let mut session = game.open(&worlds(3));
        session.reset(&seeds(0, 3), json!({"wind": 2.0}));
        session.step(0);
        let before = session.seen(0);
        assert_eq!(before[0][3], 2.0);
        let head = session.reset_with(&ResetRequest {
            seeds: vec![0, 9, 0],
            actions: vec![
                ResetAction::Leave,
                ResetAction::Seed,
                ResetAction::NextEpisode,
            ],
            parameters: json!([{"wind": 7.0}, {"wind": 3.0}, null]),
        });
        let after = session.seen(0);
        assert_eq!((head.tick, head.flags), (3, 1));
        assert_eq!(after[0], before[0], "left alone, its parameters too");
        assert_eq!((after[1][0], after[1][3]), (0.0, 3.0));
        assert_eq!((after[2][0], after[2][3]), (0.0, 2.0), "parameters stay");
        session.step(0);
        assert_eq!(session.seen(0)[0][0], 6.0);
        assert_eq!(session.trainer.close(), AppExit::Success);
    }
}
