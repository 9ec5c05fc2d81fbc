//! Pictures of games, drawn by a real renderer.
#![cfg(feature = "camera")]

use crate::client::{Client, step_path};
use crate::game::run;
use bevy_app::TaskPoolPlugin;
use bevy_app::prelude::*;
use bevy_camera::{Camera, Camera2d, ClearColorConfig, RenderTarget};
use bevy_color::Color;
use bevy_ecs::prelude::*;
use bevy_ludus::camera::RenderingPlugins;
use bevy_ludus_rest::*;
use bevy_state::prelude::*;
use std::io::{BufRead, Read};
use std::net::SocketAddr;
use std::sync::mpsc::channel;
use std::thread::JoinHandle;
use std::time::Duration;

pub const WIDTH: u32 = 20;
pub const HEIGHT: u32 = 7;
/// Where there is no graphics card, its shaders are compiled by software.
pub const DEADLINE: Duration = Duration::from_secs(60);

type Gym = AIGymState<String, ()>;

/// Which agent a camera belongs to.
#[derive(Component)]
struct Eye(usize);

/// A game in which each agent sees nothing but a colour: the one of its last action.
pub struct Painted {
    pub address: SocketAddr,
    thread: JoinHandle<AppExit>,
}

impl Painted {
    /// Starts an app that a function fills.
    pub fn start_with(fill: impl FnOnce(&mut App) + Send + 'static) -> Self {
        let (sender, receiver) = channel();
        let thread = std::thread::spawn(move || {
            let mut app = App::new();
            fill(&mut app);
            run(app, |app| {
                let _ = sender.send(app.world().resource::<RestServer>().address());
            })
        });
        Self {
            address: receiver.recv_timeout(DEADLINE).unwrap(),
            thread,
        }
    }

    /// Ends it as it ends when agents do nothing.
    pub fn end(self, client: &mut Client) {
        client.send("GET", "/step?payload=[{},{}]", "");
        assert_eq!(self.thread.join().unwrap(), AppExit::Success);
    }
}

pub fn settings(pause_interval: f32) -> AIGymSettings {
    AIGymSettings {
        width: WIDTH,
        height: HEIGHT,
        num_agents: 2,
        render_to_buffer: true,
        port: 0,
        pause_interval,
        ..Default::default()
    }
}

/// Adds the whole game to an app.
pub fn fill(app: &mut App, settings: AIGymSettings) {
    if !app.is_plugin_added::<TaskPoolPlugin>() {
        app.add_plugins(TaskPoolPlugin::default());
    }
    app.add_plugins(RenderingPlugins)
        .insert_resource(Gym::new(settings))
        .add_plugins(AIGymPlugin::<String, ()>::default())
        .add_systems(Startup, spawn_eyes)
        .add_systems(Update, (paint, publish));
}

fn spawn_eyes(gym: Res<Gym>, mut commands: Commands) {
    let gym = gym.lock().unwrap();
    for (agent, image) in gym.render_image_handles.iter().enumerate() {
        let clear_color = ClearColorConfig::Custom(Color::BLACK);
        let camera = Camera {
            clear_color,
            ..Default::default()
        };
        commands.spawn((
            Camera2d,
            camera,
            RenderTarget::from(image.clone()),
            Eye(agent),
        ));
    }
}

fn paint(
    mut controls: EventReader<EventControl>,
    mut eyes: Query<(&Eye, &mut Camera)>,
    mut next: ResMut<NextState<SimulationState>>,
    mut exits: EventWriter<AppExit>,
) {
    for EventControl(actions) in controls.read() {
        for (eye, mut camera) in &mut eyes {
            let Some(text) = &actions[eye.0] else {
                exits.write(AppExit::Success);
                continue;
            };
            let parts: Vec<u8> = text.split(' ').map(|part| part.parse().unwrap()).collect();
            let color = Color::srgb_u8(parts[0], parts[1], parts[2]);
            camera.clear_color = ClearColorConfig::Custom(color);
        }
        next.set(SimulationState::Running);
    }
}

fn publish(mut pauses: EventReader<EventPause>, gym: Res<Gym>) {
    for _ in pauses.read() {
        gym.lock().unwrap().set_env_state(());
    }
}

/// Asks for a picture, and returns its size and its pixels (RGBA).
pub fn look(client: &mut Client) -> (u32, u32, Vec<u8>) {
    client
        .stream
        .get_mut()
        .set_read_timeout(Some(DEADLINE))
        .unwrap();
    client.send("GET", "/visual_observations", "");
    let mut head = String::new();
    while !head.ends_with("\r\n\r\n") {
        assert!(client.stream.read_line(&mut head).unwrap() > 0, "{head}");
    }
    let length = crate::client::header(&head, "content-length").unwrap();
    let mut body = vec![0; length.parse().unwrap()];
    client.stream.read_exact(&mut body).unwrap();
    assert!(
        head.contains("image/png"),
        "{head}{}",
        String::from_utf8_lossy(&body)
    );
    let mut reader = png::Decoder::new(std::io::Cursor::new(body))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    (info.width, info.height, pixels)
}

/// Checks that both agents see nothing but the colour of their last action.
pub fn check_colors((width, height, pixels): &(u32, u32, Vec<u8>), colors: [&str; 2]) {
    assert_eq!((*width, *height), (2 * WIDTH, HEIGHT));
    for (index, pixel) in pixels.as_chunks::<4>().0.iter().enumerate() {
        let agent = usize::from(index as u32 % width >= WIDTH);
        let expected: Vec<i32> = colors[agent]
            .split(' ')
            .map(|part| part.parse().unwrap())
            .collect();
        for (found, expected) in pixel.iter().zip(expected) {
            let error = (i32::from(*found) - expected).abs();
            assert!(error <= 1, "{pixel:?} at {index} is not {colors:?}");
        }
        assert_eq!(pixel[3], 255);
    }
}

#[test]
fn agents_see_the_game_as_it_stands_side_by_side() {
    for pause_interval in [0.0, 0.001] {
        let game = Painted::start_with(move |app| fill(app, settings(pause_interval)));
        let mut client = Client::connect(game.address);
        for colors in [["250 10 20", "0 200 90"], ["1 2 3", "255 255 255"]] {
            client.step(&colors);
            check_colors(&look(&mut client), colors);
        }
        game.end(&mut client);
    }
}

#[test]
fn games_without_a_renderer_say_what_they_lack() {
    let game = crate::game::Game::start(
        AIGymSettings {
            render_to_buffer: true,
            ..crate::game::settings()
        },
        crate::game::Habits::default(),
    );
    let mut client = game.client();
    let response = client.ask("GET", "/visual_observations", "");
    assert_eq!(response.status, 501);
    assert!(
        response.body.contains("needs a renderer"),
        "{}",
        response.body
    );
    assert_eq!(client.ask("GET", &step_path(&["2", "2"]), "").status, 200);
}
