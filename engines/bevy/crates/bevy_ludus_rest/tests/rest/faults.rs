//! Clients that go, and games that do not answer.

use crate::client::{Client, step_path};
use crate::game::{Game, Habits, settings};
use bevy_ludus_rest::AIGymSettings;
use serde_json::Value;
use std::time::Duration;

fn num_steps(client: &mut Client) -> u64 {
    serde_json::from_str::<Value>(&client.get("/state")).unwrap()["num_steps"]
        .as_u64()
        .unwrap()
}

fn impatient() -> AIGymSettings {
    AIGymSettings {
        timeout: 1.0,
        ..settings()
    }
}

#[test]
fn a_client_that_goes_mid_step_wedges_nothing() {
    let game = Game::start(settings(), Habits::default());
    for turn in 1..=5 {
        let mut leaver = game.client();
        leaver.send("GET", &step_path(&["sleep 50", "1"]), "");
        game.await_begun(2 * turn - 1);
        drop(leaver);
        let mut client = game.client();
        client.step(&["0", "0"]);
        // The step of the client that left was played, once.
        assert_eq!(num_steps(&mut client), 2 * turn);
    }
}

#[test]
fn a_slow_game_is_reported_and_heard_again() {
    let game = Game::start(impatient(), Habits::default());
    let mut client = game.client();
    client.step(&["0", "0"]);
    let late = client.ask("GET", &step_path(&["sleep 3000", "0"]), "");
    assert_eq!(late.status, 504);
    assert!(
        late.body.starts_with("the game did not answer for 1 s"),
        "{}",
        late.body
    );
    // The game still sleeps, but its server does not.
    assert_eq!(num_steps(&mut client), 1);
    std::thread::sleep(Duration::from_millis(2500));
    client.step(&["0", "0"]);
    assert_eq!(num_steps(&mut client), 3);
}

#[test]
fn a_client_that_waits_too_long_for_its_turn_gets_an_error() {
    let game = Game::start(impatient(), Habits::default());
    let mut first = game.client();
    let mut second = game.client();
    first.send("GET", &step_path(&["sleep 1500", "0"]), "");
    game.await_begun(1);
    let statuses = [
        second.ask("GET", "/reset", "").status,
        first.receive().status,
    ];
    // The first one's time is over when the second one's turn comes, or the other way round.
    assert!(statuses.contains(&504), "{statuses:?}");
    assert!(
        statuses.iter().all(|status| [503, 504].contains(status)),
        "{statuses:?}"
    );
}

#[test]
fn a_game_that_never_pauses_is_reported() {
    let game = Game::start(impatient(), Habits::default());
    let mut client = game.client();
    for _ in 0..2 {
        let late = client.ask("GET", &step_path(&["load", "0"]), "");
        assert_eq!(late.status, 504, "{}", late.body);
        assert!(
            late.body.contains("SimulationState::PausedForControl"),
            "{}",
            late.body
        );
    }
    assert_eq!(num_steps(&mut client), 0);
}
