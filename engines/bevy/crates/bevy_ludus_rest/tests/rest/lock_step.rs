//! Without a timer: as fast as clients ask, and by the same clock each time.

use crate::client::Client;
use crate::game::{Game, Habits, settings};
use bevy_ludus_rest::AIGymSettings;
use serde_json::Value;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

fn state(client: &mut Client) -> Value {
    serde_json::from_str(&client.get("/state")).unwrap()
}

#[test]
fn each_step_runs_one_update_of_the_same_length() {
    let settings = AIGymSettings {
        step_seconds: 0.25,
        ..settings()
    };
    let game = Game::start(settings, Habits::default());
    let mut client = game.client();
    client.step(&["0", "0"]);
    let before = state(&mut client);
    for _ in 0..10 {
        client.step(&["0", "0"]);
    }
    let after = state(&mut client);
    let passed = |name: &str| after[name].as_u64().unwrap() - before[name].as_u64().unwrap();
    assert_eq!((passed("num_ran"), passed("milliseconds")), (10, 2500));
}

#[test]
fn a_waiting_game_rests_and_its_clock_stands_still() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.step(&["0", "0"]);
    let before = state(&mut client);
    let num_updates = game.num_updates.load(Ordering::Relaxed);
    let began = Instant::now();
    std::thread::sleep(Duration::from_millis(500));
    let passed = game.num_updates.load(Ordering::Relaxed) - num_updates;
    // A waiting game updates ten times a second.
    let at_most = began.elapsed().as_millis() as u64 / 100 + 3;
    assert!((1..=at_most).contains(&passed), "{passed} updates");
    assert_eq!(state(&mut client), before);
}

#[test]
fn a_step_takes_three_updates() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.step(&["0", "0"]);
    let before = game.num_updates.load(Ordering::Relaxed);
    for _ in 0..100 {
        client.step(&["0", "0"]);
    }
    let passed = game.num_updates.load(Ordering::Relaxed) - before;
    // More only if a client is so slow that the game updates while it waits.
    assert!((300..400).contains(&passed), "{passed} updates");
}

#[test]
fn clients_at_once_are_served_in_turns() {
    let game = Game::start(settings(), Habits::default());
    let play = || {
        let mut client = game.client();
        let payload = r#"[{"action":"1"},{"action":"0"}]"#;
        let steps = (0..50).map(|_| client.ask("POST", "/step?include=state", payload).body);
        let answers = steps.map(|body| serde_json::from_str::<Value>(&body).unwrap());
        answers
            .map(|answer| answer["state"]["num_steps"].as_u64().unwrap())
            .collect::<Vec<_>>()
    };
    let mut heard = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(play)).collect();
        threads
            .into_iter()
            .flat_map(|thread| thread.join().unwrap())
            .collect::<Vec<_>>()
    });
    heard.sort_unstable();
    // Each answer came with the state after its own step, and no step was played twice.
    assert_eq!(heard, (1..=200).collect::<Vec<u64>>());
}

#[test]
fn requests_that_are_sent_together_are_answered_in_order() {
    let game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    let path = crate::client::step_path(&["1", "0"]);
    for _ in 0..5 {
        client.send("GET", &path, "");
        client.send("GET", "/state", "");
    }
    for turn in 1..=5 {
        assert_eq!(client.receive().status, 200);
        let state: Value = serde_json::from_str(&client.receive().body).unwrap();
        assert_eq!(state["num_steps"], turn);
    }
}

#[test]
fn an_app_may_run_inside_an_asynchronous_runtime() {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .build()
        .unwrap();
    let _inside = runtime.enter();
    let mut app = crate::game::make_app(settings(), Habits::default());
    app.finish();
    app.cleanup();
    app.update();
    let address = app
        .world()
        .resource::<bevy_ludus_rest::RestServer>()
        .address();
    let client = std::thread::spawn(move || Client::connect(address).step(&["7", "0"]));
    let deadline = std::time::Instant::now() + Duration::from_secs(20);
    while !client.is_finished() {
        assert!(std::time::Instant::now() < deadline);
        app.update();
    }
    assert!(client.join().unwrap().contains("3.5"));
}
