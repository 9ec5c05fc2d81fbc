//! How apps begin and end.

use crate::client::{Client, step_path};
use crate::game::{Counts, Game, Habits, make_app, run, settings};
use bevy_app::prelude::*;
use bevy_ludus_rest::{AIGymPlugin, AIGymSettings};
use std::net::TcpListener;
use std::time::{Duration, Instant};

#[test]
fn an_app_that_exits_frees_its_port() {
    let mut game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.step(&["1", "1"]);
    let began = Instant::now();
    assert_eq!(game.end(), AppExit::Success);
    assert!(began.elapsed() < Duration::from_secs(5));
    drop(TcpListener::bind(game.address).unwrap());
    let again = AIGymSettings {
        port: game.address.port(),
        ..settings()
    };
    let again = Game::start(again, Habits::default());
    assert_eq!(again.address, game.address);
    assert_eq!(
        Client::connect(again.address)
            .step(&["2", "2"])
            .matches("1.0")
            .count(),
        2
    );
}

#[test]
fn a_client_of_an_app_that_exits_gets_503() {
    let mut game = Game::start(settings(), Habits::default());
    let mut client = game.client();
    client.step(&["0", "0"]);
    client.send("GET", &step_path(&["load", "0"]), "");
    game.await_begun(2);
    game.end();
    let response = client.receive();
    assert_eq!(
        (response.status, response.body.as_str()),
        (503, "the game has ended")
    );
}

#[test]
fn an_app_whose_port_is_taken_ends_with_an_error() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let app = make_app(AIGymSettings { port, ..settings() }, Habits::default());
    assert_eq!(run(app, |_| ()), AppExit::error());
}

#[test]
fn an_app_without_the_shared_state_ends_with_an_error() {
    let exit = App::new()
        .add_plugins(AIGymPlugin::<String, Counts>::default())
        .run();
    assert_eq!(exit, AppExit::error());
}
