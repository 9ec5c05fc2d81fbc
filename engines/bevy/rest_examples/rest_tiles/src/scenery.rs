//! How the tiles look. All colours are as they are said to be: nothing is lit or shaded.
//!
//! An agent's picture is three tiles wide and three high. The lowest third shows the tile that the
//! agent stands on, in the middle, and its neighbours; above them, and beyond the ends of the row, is
//! sky. Red counts the tiles, green the agents: tile *t* of agent *a* has the colour
//! (20 + 20·*t*, 40 + 50·*a*, 200), its sky (0, 40 + 50·*a*, 60), and the goal is white.

use crate::{Game, Gym, NUM_TILES};
use bevy_asset::Assets;
use bevy_camera::{
    Camera, Camera3d, ClearColorConfig, OrthographicProjection, Projection, RenderTarget,
    ScalingMode,
};
use bevy_color::Color;
use bevy_core_pipeline::tonemapping::Tonemapping;
use bevy_ecs::prelude::*;
use bevy_math::Vec3;
use bevy_math::primitives::Rectangle;
use bevy_mesh::{Mesh, Mesh3d};
use bevy_pbr::{MeshMaterial3d, StandardMaterial};
use bevy_render::view::Msaa;
use bevy_transform::components::Transform;

/// Of an agent's picture, tiles.
const VIEW: f32 = 3.0;
/// From row to row, tiles: no agent sees the row of another one.
const ROW_DISTANCE: f32 = 10.0;
/// Before the tiles, so that it hides the one behind it.
const GOAL_DEPTH: f32 = 0.5;
const EYE_DEPTH: f32 = 5.0;

/// The camera of an agent.
#[derive(Component)]
pub struct Eye(usize);

/// The white tile in the row of an agent.
#[derive(Component)]
pub struct Goal(usize);

/// Lays a row of tiles for each agent.
pub fn spawn_rows(
    game: Res<Game>,
    mut meshes: ResMut<Assets<Mesh>>,
    mut materials: ResMut<Assets<StandardMaterial>>,
    mut commands: Commands,
) {
    let square = Mesh3d(meshes.add(Rectangle::new(1.0, 1.0)));
    let mut paint = |color| {
        MeshMaterial3d(materials.add(StandardMaterial {
            base_color: color,
            unlit: true,
            ..StandardMaterial::default()
        }))
    };
    for agent in 0..game.walkers.agents.len() {
        for tile in 0..NUM_TILES {
            let red = (20 + 20 * tile) as u8;
            let color = paint(Color::srgb_u8(red, green_of(agent), 200));
            let place = Transform::from_translation(place_of(agent, tile, 0.0));
            commands.spawn((square.clone(), color, place));
        }
        let white = paint(Color::WHITE);
        commands.spawn((square.clone(), white, Transform::default(), Goal(agent)));
    }
}

/// Gives each agent a camera that draws into its picture.
pub fn spawn_eyes(gym: Res<Gym>, mut commands: Commands) {
    let Ok(gym) = gym.lock() else { return };
    for (agent, image) in gym.render_image_handles.iter().enumerate() {
        let sky = Color::srgb_u8(0, green_of(agent), 60);
        let scaling_mode = ScalingMode::Fixed {
            width: VIEW,
            height: VIEW,
        };
        commands.spawn((
            Eye(agent),
            Camera3d::default(),
            Camera {
                clear_color: ClearColorConfig::Custom(sky),
                ..Camera::default()
            },
            Projection::Orthographic(OrthographicProjection {
                scaling_mode,
                ..OrthographicProjection::default_3d()
            }),
            RenderTarget::from(image.clone()),
            Tonemapping::None,
            // No pixel is a mixture.
            Msaa::Off,
        ));
    }
}

/// Moves eyes and goals to where the game says that they are.
pub fn show(
    game: Res<Game>,
    mut eyes: Query<(&Eye, &mut Transform)>,
    mut goals: Query<(&Goal, &mut Transform), Without<Eye>>,
) {
    let walkers = &game.walkers.agents;
    for (Eye(agent), mut transform) in &mut eyes {
        // The tiles fill the lowest third of the picture.
        let above = Vec3::Y * (VIEW - 1.0) / 2.0;
        transform.translation = place_of(*agent, walkers[*agent].tile, EYE_DEPTH) + above;
    }
    for (Goal(agent), mut transform) in &mut goals {
        transform.translation = place_of(*agent, walkers[*agent].goal, GOAL_DEPTH);
    }
}

fn place_of(agent: usize, tile: u32, depth: f32) -> Vec3 {
    Vec3::new(tile as f32, agent as f32 * ROW_DISTANCE, depth)
}

fn green_of(agent: usize) -> u8 {
    (40 + 50 * agent) as u8
}
