//! Games with `LudusPlugin` beside the plugin of bevy_rl: both show pictures, by one renderer.
#![cfg(feature = "camera")]

use crate::client::Client;
use crate::pixels::{DEADLINE, HEIGHT, Painted, WIDTH, check_colors, fill, look, settings};
use crate::trainer::Session;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bevy_app::prelude::*;
use bevy_camera::{Camera, Camera2d, ClearColorConfig};
use bevy_color::Color;
use bevy_ecs::prelude::*;
use bevy_ludus::camera::{LudusCamera, LudusFilmCamera, Picture};
use bevy_ludus::prelude::*;
use bevy_ludus_rest::*;
use serde_json::{Value, json};
use std::net::SocketAddr;
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;

/// What the agents of Ludus see, and what is filmed of them.
const SEEN: [u8; 3] = [10, 20, 200];
const FILMED: [u8; 3] = [200, 20, 10];

#[derive(ActionSpace)]
enum Choice {
    Stay,
    Go,
}

/// Adds an agent of Ludus that sees, and a camera for films.
fn add_ludus(app: &mut App) {
    app.add_policy::<(), Choice>(Policy::new("hero").camera("eye", Picture::rgb(WIDTH, HEIGHT)))
        .add_observer(fill_world)
        .add_plugins(LudusPlugin::default().name("both"));
}

fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    let home = InWorld(add.entity);
    let hero = commands.spawn((Agent::of("hero"), home)).id();
    commands.spawn((LudusCamera::of(hero, "eye"), Camera2d, painted(SEEN), home));
    let film = LudusFilmCamera {
        width: WIDTH,
        height: HEIGHT,
    };
    commands.spawn((film, Camera2d, painted(FILMED), home));
}

fn painted([red, green, blue]: [u8; 3]) -> Camera {
    Camera {
        clear_color: ClearColorConfig::Custom(Color::srgb_u8(red, green, blue)),
        ..Camera::default()
    }
}

/// Plays two steps, and looks after each.
fn play(client: &mut Client) {
    for colors in [["250 10 20", "0 200 90"], ["1 2 3", "255 255 255"]] {
        client.step(&colors);
        check_colors(&look(client), colors);
    }
}

#[test]
fn pictures_come_without_a_trainer_in_either_order_of_the_plugins() {
    let ludus_first = |app: &mut App| {
        add_ludus(app);
        app.add_plugins(LudusTcpPlugin::default());
        fill(app, settings(0.0));
    };
    let ludus_last = |app: &mut App| {
        fill(app, settings(0.001));
        add_ludus(app);
    };
    for add_all in [ludus_first as fn(&mut App), ludus_last] {
        let game = Painted::start_with(add_all);
        let mut client = Client::connect(game.address);
        play(&mut client);
        game.end(&mut client);
    }
}

#[test]
fn pictures_come_while_a_trainer_plays() {
    let (sender, receiver) = channel();
    let mut session = Session::open(
        move |app| {
            fill(app, settings(0.0));
            add_ludus(app);
            app.insert_resource(AddressSender(sender))
                .add_systems(PostStartup, send_address);
        },
        &json!({"num_worlds": 2}),
    );
    session.reset(&[Some(1), Some(2)], Value::Null);
    let client = play_on_a_thread(receiver.recv_timeout(DEADLINE).unwrap());
    let mut num_steps = 0;
    while !client.is_finished() {
        session.step(1);
        check_ludus(&session);
        num_steps += 1;
        if num_steps % 4 == 0 {
            check_film(&mut session);
        }
    }
    client.join().unwrap();
    session.step(0);
    check_ludus(&session);
    assert_eq!(session.trainer.close(), AppExit::Success);
}

#[derive(Resource)]
struct AddressSender(Sender<SocketAddr>);

fn send_address(server: Res<RestServer>, sender: Res<AddressSender>) {
    let _ = sender.0.send(server.address());
}

fn play_on_a_thread(address: SocketAddr) -> JoinHandle<()> {
    std::thread::spawn(move || {
        let mut client = Client::connect(address);
        play(&mut client);
        play(&mut client);
    })
}

/// Checks the pictures of Ludus's own agents.
fn check_ludus(session: &Session) {
    let policy = &session.batch.layout().policies[0];
    for slot in 0..policy.num_agents {
        check_plain(&session.batch.bytes()[policy.entries[0].row(slot)], SEEN);
    }
}

fn check_film(session: &mut Session) {
    let result = session
        .trainer
        .call(json!({"world": 1}), "picture", json!([]));
    let rgb = result["value"][0]["rgb"].as_str().unwrap();
    check_plain(&STANDARD.decode(rgb).unwrap(), FILMED);
}

fn check_plain(rgb: &[u8], expected: [u8; 3]) {
    assert_eq!(rgb.len(), (WIDTH * HEIGHT * 3) as usize);
    for pixel in rgb.as_chunks::<3>().0 {
        let is_right = pixel.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 1);
        assert!(is_right, "{pixel:?} is not {expected:?}");
    }
}
