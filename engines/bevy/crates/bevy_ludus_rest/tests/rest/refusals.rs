//! What is wrong with a request is said, and does no harm.

use crate::client::{Client, header, step_path};
use crate::game::{Game, Habits, settings};
use proptest::prelude::*;
use std::io::Write;

#[test]
fn each_mistake_has_a_status_and_a_reason() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    let three = step_path(&["1", "1", "1"]);
    let cases = [
        ("GET", "/nowhere", 404, "there is no /nowhere"),
        ("GET", "/", 404, "/state, /step, /reset"),
        ("POST", "/state", 405, "one of: GET"),
        ("DELETE", "/step", 405, "one of: GET, POST"),
        ("GET", "/step", 400, "the payload is missing"),
        ("POST", "/step", 400, "not a list of actions"),
        ("GET", "/step?payload=", 400, "not a list of actions"),
        ("GET", "/step?payload=[1,2]", 400, "not a list of actions"),
        (
            "GET",
            "/step?payload=[{%22action%22:1},{}]",
            400,
            "expected a string",
        ),
        ("GET", "/step?payload=%ff%fe", 400, "not a list of actions"),
        (
            "GET",
            three.as_str(),
            400,
            "must have 2 actions, one per agent; it has 3",
        ),
        ("GET", "/visual_observations", 501, "feature `camera`"),
    ];
    for (verb, path, status, reason) in cases {
        let response = client.ask(verb, path, "");
        assert_eq!(response.status, status, "{verb} {path}");
        assert!(
            response.body.contains(reason),
            "{verb} {path}: {}",
            response.body
        );
    }
    assert_eq!(
        header(&client.ask("PUT", "/reset", "").head, "allow").unwrap(),
        "GET, POST"
    );
    assert_eq!(client.step(&["2", "2"]).matches("1.0").count(), 2);
}

#[test]
fn a_payload_that_is_too_long_is_refused() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.send("POST", "/step", &" ".repeat((16 << 20) + 1));
    assert_eq!(client.receive().status, 413);
    let mut other = game.client();
    let path = format!("/step?payload={}", "x".repeat(100_000));
    assert_eq!(other.ask("GET", &path, "").status, 414);
    assert_eq!(game.client().step(&["2", "2"]).matches("1.0").count(), 2);
}

#[test]
fn a_game_that_names_an_unknown_agent_is_told_so() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    let response = client.ask("GET", &step_path(&["reward 2", "0"]), "");
    assert_eq!(response.status, 500);
    let expected = "the game called set_reward(2, …), but there are 2 agents";
    assert!(response.body.starts_with(expected), "{}", response.body);
    assert_eq!(client.step(&["2", "2"]).matches("1.0").count(), 2);
}

#[test]
fn methods_without_a_request_return_at_once() {
    let gym = crate::game::Gym::new(settings());
    let gym = gym.lock().unwrap();
    assert!(!gym.is_next_action() && !gym.is_reset_request());
    assert_eq!(gym.receive_action_strings(), [None, None]);
    gym.receive_reset_request();
    gym.send_step_result(vec![]);
    gym.send_reset_result(true);
}

#[test]
fn no_bytes_break_the_server() {
    let game = Game::start(settings(), Habits::default());
    let address = game.address;
    let mut runner = proptest::test_runner::TestRunner::new(ProptestConfig::with_cases(64));
    let begin = prop_oneof![
        Just(""),
        Just("GET /step?payload="),
        Just("POST /step HTTP/1.1\r\n")
    ];
    let strategy = (begin, any::<Vec<u8>>(), any::<bool>());
    let send = |(begin, bytes, has_end): (&str, Vec<u8>, bool)| {
        let mut client = Client::connect(address);
        let stream = client.stream.get_mut();
        let end: &[u8] = if has_end { b" HTTP/1.1\r\n\r\n" } else { b"" };
        // The server may close while this is written.
        let _ = stream.write_all(&[begin.as_bytes(), &bytes, end].concat());
        let _ = stream.shutdown(std::net::Shutdown::Both);
        prop_assert!(Client::connect(address).get("/state").contains("numbers"));
        Ok(())
    };
    Client::connect(address).get("/reset");
    runner.run(&strategy, send).unwrap();
}
