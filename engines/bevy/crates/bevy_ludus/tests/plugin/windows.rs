//! Games with windows, whose renderer Ludus has taken.

use bevy_app::prelude::*;
use bevy_app::{PluginsState, TaskPoolPlugin};
use bevy_asset::{Assets, Handle};
use bevy_camera::{Camera, Camera2d, ClearColorConfig, RenderTarget};
use bevy_color::Color;
use bevy_ecs::prelude::*;
use bevy_image::Image;
use bevy_ludus::camera::RenderingPlugins;
use bevy_ludus::prelude::*;
use bevy_render::gpu_readback::{Readback, ReadbackComplete};
use bevy_render::render_resource::{TextureFormat, TextureUsages};
use bevy_window::Window;
use std::time::{Duration, Instant};

/// A row of this many pixels is read back without padding.
const SIZE: u32 = 64;
const DEADLINE: Duration = Duration::from_secs(60);

#[derive(ActionSpace)]
enum Choice {
    Stay,
    Go,
}

#[derive(Default, ObservationSpace)]
struct Place {
    x: f32,
}

/// What was drawn last.
#[derive(Resource, Default)]
struct Seen(Vec<u8>);

/// A game without a trainer, in which one camera sees nothing but a colour.
fn make_game() -> App {
    let mut app = App::new();
    app.add_plugins((TaskPoolPlugin::default(), RenderingPlugins))
        .add_policy::<Place, Choice>(Policy::new("hero"))
        .add_observer(fill_world)
        .add_systems(Observe, observe)
        .add_plugins(LudusPlugin::default().name("windowed"))
        .add_plugins(LudusTcpPlugin::default())
        .init_resource::<Seen>();
    while app.plugins_state() == PluginsState::Adding {
        std::thread::yield_now();
    }
    app.finish();
    app.cleanup();
    let image = add_image(app.world_mut());
    let camera = Camera {
        clear_color: ClearColorConfig::Custom(Color::srgb_u8(10, 200, 30)),
        ..Camera::default()
    };
    app.world_mut()
        .spawn((Camera2d, camera, RenderTarget::from(image.clone())));
    app.world_mut().spawn(Readback::texture(image)).observe(
        |read: On<ReadbackComplete>, mut seen: ResMut<Seen>| seen.0.clone_from(&read.data),
    );
    app
}

fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    commands.spawn((Agent::of("hero"), InWorld(add.entity)));
}

fn observe(mut heroes: Query<&mut Observation<Place>>) {
    for mut seen in &mut heroes {
        seen.0.x = 1.0;
    }
}

fn add_image(world: &mut World) -> Handle<Image> {
    let format = TextureFormat::Rgba8UnormSrgb;
    let mut image = Image::new_target_texture(SIZE, SIZE, format, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    world.resource_mut::<Assets<Image>>().add(image)
}

fn is_drawn(app: &App) -> bool {
    let seen = &app.world().resource::<Seen>().0;
    seen.len() == (SIZE * SIZE * 4) as usize
        && seen
            .as_chunks::<4>()
            .0
            .iter()
            .all(|pixel| pixel == &[10, 200, 30, 255])
}

#[test]
fn a_game_is_drawn_as_long_as_it_has_a_window() {
    let mut app = make_game();
    for _ in 0..30 {
        app.update();
    }
    assert!(!is_drawn(&app), "nobody looks");
    app.world_mut().spawn(Window::default());
    let deadline = Instant::now() + DEADLINE;
    while !is_drawn(&app) {
        assert!(Instant::now() < deadline, "it is never drawn");
        assert_eq!(app.should_exit(), None);
        app.update();
    }
}
