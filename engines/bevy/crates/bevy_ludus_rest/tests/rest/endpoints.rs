//! What clients of bevy_rl receive: the same bytes.

use crate::client::header;
use crate::game::{Game, Habits, settings};
use bevy_ludus_rest::AIGymSettings;
use serde_json::Value;

const NOTHING: &str =
    r#"[{"is_terminated":false,"reward":0.0},{"is_terminated":false,"reward":0.0}]"#;

/// With and without a timer.
fn both() -> [AIGymSettings; 2] {
    [0.0, 0.000_1].map(|pause_interval| AIGymSettings {
        pause_interval,
        ..settings()
    })
}

fn numbers(state: &str) -> Value {
    serde_json::from_str::<Value>(state).unwrap()["numbers"].take()
}

#[test]
fn a_step_is_played_and_answered() {
    for settings in both() {
        let game = Game::start(settings, Habits::default());
        let mut client = game.client();
        let answer = client.step(&["3", "-1"]);
        let expected =
            r#"[{"is_terminated":false,"reward":1.5},{"is_terminated":false,"reward":-0.5}]"#;
        assert_eq!(answer, expected);
        assert_eq!(numbers(&client.get("/state")), serde_json::json!([3, -1]));
        let answer = client.step(&["8", "0"]);
        let expected =
            r#"[{"is_terminated":true,"reward":5.5},{"is_terminated":false,"reward":-0.5}]"#;
        assert_eq!(answer, expected);
    }
}

#[test]
fn the_fields_of_the_state_come_in_the_order_of_the_alphabet() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.get("/reset");
    let state = client.get("/state");
    // The clock of an app begins with its second update.
    let expected = r#"{"milliseconds":16,"num_ran":2,"num_steps":0,"numbers":[0,0]}"#;
    assert_eq!(state, expected);
}

#[test]
fn a_reset_is_asked_for_by_either_verb() {
    for settings in both() {
        let game = Game::start(settings, Habits::default());
        let mut client = game.client();
        for verb in ["GET", "POST"] {
            client.step(&["8", "8"]);
            let response = client.ask(verb, "/reset", "");
            assert_eq!(
                (response.status, response.body.as_str()),
                (200, NOTHING),
                "{verb}"
            );
        }
        client.step(&["1", "2"]);
        assert_eq!(numbers(&client.get("/state")), serde_json::json!([1, 2]));
    }
}

#[test]
fn no_action_is_null_or_left_out() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.get("/step?payload=[{%22action%22:null},{}]");
    assert_eq!(numbers(&client.get("/state")), serde_json::json!([0, 0]));
}

#[test]
fn a_payload_may_come_in_the_body_and_the_state_with_the_answer() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    let payload = r#"[{"action":"1"},{"action":"2"}]"#;
    let plain = client.ask("POST", "/step", payload);
    assert_eq!(plain.status, 200, "{}", plain.body);
    let full = client.ask("POST", "/step?include=state", payload);
    let answer: Value = serde_json::from_str(&full.body).unwrap();
    assert_eq!(answer["agents"][1]["reward"], 2.0);
    assert_eq!(answer["state"]["numbers"], serde_json::json!([2, 4]));
}

#[test]
fn answers_are_text_that_names_its_maker() {
    let game = Game::start(settings(), Habits::default());
    let head = game.client().ask("GET", "/state", "").head;
    assert_eq!(header(&head, "content-type").unwrap(), "text/plain");
    assert!(header(&head, "server").unwrap().starts_with("bevy_ludus/"));
}

#[test]
fn games_that_send_no_results_are_answered_when_they_are_paused_again() {
    for settings in both() {
        let habits = Habits {
            is_silent: true,
            ..Default::default()
        };
        let game = Game::start(settings, habits);
        let mut client = game.client();
        for turn in 1..4 {
            client.step(&["1", "2"]);
            assert_eq!(
                numbers(&client.get("/state")),
                serde_json::json!([turn, 2 * turn])
            );
        }
        client.get("/reset");
        assert_eq!(numbers(&client.get("/state")), serde_json::json!([0, 0]));
    }
}

#[test]
fn games_may_answer_without_running() {
    for settings in both() {
        let habits = Habits {
            stays_paused: true,
            ..Default::default()
        };
        let game = Game::start(settings, habits);
        let mut client = game.client();
        client.step(&["4", "0"]);
        assert_eq!(client.step(&["2", "0"]).matches("3.0").count(), 1);
    }
}

#[test]
fn a_game_that_loads_is_paused_only_when_it_is_ready() {
    let loading = |num_loading| Habits {
        num_loading,
        ..Default::default()
    };
    for settings in both() {
        let impatient = AIGymSettings {
            timeout: 0.1,
            ..settings.clone()
        };
        let game = Game::start(impatient, loading(u64::MAX));
        let response = game.client().ask("GET", "/reset", "");
        assert_eq!(response.status, 504, "{}", response.body);
        assert_eq!(game.client().get("/state"), "null");
        let game = Game::start(settings, loading(50));
        assert_eq!(game.client().step(&["1", "1"]).matches("0.5").count(), 2);
    }
}
