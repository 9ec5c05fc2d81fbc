//! What is refused, and in which words.

use crate::game::*;
use crate::trainer::{Session, Trainer};
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_ludus::wire::{ErrorCode, FrameType, encode_frame};
use serde_json::{Value, json};

/// Returns how a game refuses settings.
fn refusal(fill: impl FnOnce(&mut App) + Send + 'static, config: &Value) -> (ErrorCode, String) {
    let mut trainer = Trainer::connect(fill);
    trainer.welcome(config);
    let report = trainer.refusal();
    assert_ne!(trainer.end(), AppExit::Success);
    (report.code, report.message)
}

#[test]
fn bad_settings_and_games_are_refused() {
    let build = |app: &mut App| Game::default().build(app);
    for (config, expected) in [
        (json!({"num_worlds": 0}), "num_worlds is 0"),
        (json!({"num_worlds": 65_537}), "65536"),
        (json!({"num_worlds": "many"}), "whole number"),
        (json!({"layout": "heap"}), "heap"),
        (json!({"layout": "isolated"}), "cannot make an app"),
        (json!({"scene": "res://x.tscn"}), "no scene"),
        (json!({"ticks_per_step": 0}), "ticks_per_step is 0"),
    ] {
        let (code, message) = refusal(build, &config);
        assert_eq!(code, ErrorCode::Config, "{message}");
        assert!(message.contains(expected), "{message}");
    }
    let (_, message) = refusal(
        |app| {
            app.add_plugins(LudusPlugin::default());
        },
        &worlds(1),
    );
    assert!(message.contains("no policy"), "{message}");
    let lonely = |app: &mut App| {
        Game {
            agents: 0,
            ..Game::default()
        }
        .build(app)
    };
    let (_, message) = refusal(lonely, &worlds(1));
    assert!(
        message.contains("no agent has the policy hero"),
        "{message}"
    );
    let misspelt = |app: &mut App| {
        Game {
            policy: || Policy::new("heroine"),
            ..Game::default()
        }
        .build(app);
    };
    let (_, message) = refusal(misspelt, &worlds(1));
    assert!(
        message.contains("\"hero\"; the app has: heroine"),
        "{message}"
    );
    let stray = |app: &mut App| {
        Game::default().build(app);
        app.world_mut().spawn(Agent::of("hero"));
    };
    let (_, message) = refusal(stray, &worlds(1));
    assert!(message.contains("in no world"), "{message}");
}

#[test]
fn violations_are_told_and_end_the_game() {
    let step = |length: usize| encode_frame(FrameType::Step, &vec![0; length]).unwrap();
    let mut wrong_choice = step(8);
    wrong_choice[8] = 4;
    let with_flags = [1, 0, 0, 0, 5, 1, 0, 0, 0].to_vec();
    for (frame, code, expected) in [
        (step(8), ErrorCode::Sequence, "STEP before the first RESET"),
        (step(16), ErrorCode::Frame, "STEP has 16 bytes, expected 8"),
        (wrong_choice, ErrorCode::Frame, "expected 0 to 3, got 4"),
        (with_flags, ErrorCode::Frame, "flags 1"),
        (
            encode_frame(FrameType::Hello, b"{}").unwrap(),
            ErrorCode::Sequence,
            "HELLO",
        ),
        (
            encode_frame(FrameType::Call, b"[]").unwrap(),
            ErrorCode::Frame,
            "JSON object",
        ),
        (
            encode_frame(FrameType::Reset, &[0; 8]).unwrap(),
            ErrorCode::Frame,
            "num_worlds",
        ),
    ] {
        let mut session = Game::default().open(&worlds(1));
        if code != ErrorCode::Sequence {
            session.reset(&seeds(0, 1), Value::Null);
        }
        session.trainer.send(&frame);
        let report = session.trainer.refusal();
        assert_eq!(report.code, code, "{}", report.message);
        assert!(report.message.contains(expected), "{}", report.message);
        assert_ne!(session.trainer.end(), AppExit::Success);
    }
}

#[test]
fn a_paused_clock_is_a_clear_error() {
    let fill = |app: &mut App| {
        Game::default().build(app);
        app.add_systems(
            Update,
            |mut time: ResMut<bevy_time::Time<bevy_time::Virtual>>| time.pause(),
        );
    };
    let mut session = Session::open(fill, &worlds(1));
    session.reset(&seeds(0, 1), Value::Null);
    session.step(0);
    session
        .trainer
        .send(&encode_frame(FrameType::Step, session.actions.payload()).unwrap());
    let report = session.trainer.refusal();
    assert_eq!(report.code, ErrorCode::Game);
    assert!(
        report.message.contains("3 ticks have run, expected 6"),
        "{}",
        report.message
    );
    assert_ne!(session.trainer.end(), AppExit::Success);
}
