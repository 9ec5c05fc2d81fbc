//! How cart and pole look, for films. Nothing is lit, so that pictures are quick to draw in software.

use crate::game::TRACK_HALF_LENGTH;
use crate::motion::Cart;
use bevy_app::prelude::*;
use bevy_asset::Assets;
use bevy_camera::visibility::Visibility;
use bevy_camera::{Camera, Camera3d, ClearColorConfig};
use bevy_color::Color;
use bevy_core_pipeline::tonemapping::Tonemapping;
use bevy_ecs::prelude::*;
use bevy_light::LightPlugin;
use bevy_ludus::camera::{LudusFilmCamera, RenderingPlugins};
use bevy_ludus::prelude::*;
use bevy_math::primitives::Cuboid;
use bevy_math::{Quat, Vec3};
use bevy_mesh::{Mesh, Mesh3d};
use bevy_pbr::{MeshMaterial3d, PbrPlugin, StandardMaterial};
use bevy_transform::components::Transform;

type Material = MeshMaterial3d<StandardMaterial>;

const SKY: Color = Color::srgb_u8(188, 214, 235);
/// Sizes of the cart and of the pole, metres. The pole ends where that of the Godot example does, and
/// is drawn down to the hinge, which is in the middle of the cart.
const CART: Vec3 = Vec3::new(2.0, 1.2, 3.0);
const POLE: Vec3 = Vec3::new(0.6, 11.6, 1.0);
/// From one post beside the track to the next, metres: they show how fast the cart goes.
const POST_DISTANCE: usize = 5;
/// Where the film is taken from, beside the cart, metres.
const CAMERA: Vec3 = Vec3::new(26.0, 7.0, 0.0);
const LOOKED_AT: Vec3 = Vec3::new(0.0, 5.0, 0.0);

/// Draws the carts.
pub struct ViewPlugin;

impl Plugin for ViewPlugin {
    fn build(&self, app: &mut App) {
        app.add_plugins((RenderingPlugins, LightPlugin, PbrPlugin::default()))
            .init_resource::<Shapes>()
            .add_observer(furnish)
            .add_observer(dress)
            .add_systems(Observe, (show_carts, show_poles, follow));
    }
}

/// What all worlds share.
#[derive(Resource)]
struct Shapes {
    cube: Mesh3d,
    track: Material,
    post: Material,
    cart: Material,
    pole: Material,
}

impl FromWorld for Shapes {
    fn from_world(world: &mut World) -> Self {
        let mut meshes = world.resource_mut::<Assets<Mesh>>();
        let cube = Mesh3d(meshes.add(Cuboid::new(1.0, 1.0, 1.0)));
        let mut materials = world.resource_mut::<Assets<StandardMaterial>>();
        let mut paint = |red, green, blue| {
            MeshMaterial3d(materials.add(StandardMaterial {
                base_color: Color::srgb_u8(red, green, blue),
                unlit: true,
                ..StandardMaterial::default()
            }))
        };
        Self {
            cube,
            track: paint(120, 113, 108),
            post: paint(168, 140, 110),
            cart: paint(37, 99, 235),
            pole: paint(230, 90, 30),
        }
    }
}

/// The pole of the cart that it hangs on.
#[derive(Component)]
struct Pole;

/// Puts the track, its posts and the camera into a world.
fn furnish(add: On<Add, LudusWorld>, shapes: Res<Shapes>, mut commands: Commands) {
    let home = InWorld(add.entity);
    let mut put = |material: &Material, middle, size| {
        let transform = Transform::from_translation(middle).with_scale(size);
        commands.spawn((home, shapes.cube.clone(), material.clone(), transform));
    };
    let length = 2.0 * TRACK_HALF_LENGTH;
    put(
        &shapes.track,
        Vec3::new(0.0, -0.2, 0.0),
        Vec3::new(3.0, 0.4, length),
    );
    let end = TRACK_HALF_LENGTH as i32;
    for place in (-end..=end).step_by(POST_DISTANCE) {
        let height = if place % 10 == 0 { 1.6 } else { 0.8 };
        let middle = Vec3::new(-3.0, 0.5 * height, place as f32);
        put(&shapes.post, middle, Vec3::new(0.3, height, 0.3));
    }
    commands.spawn((home, film_camera()));
}

fn film_camera() -> impl Bundle {
    let film = LudusFilmCamera {
        width: 480,
        height: 270,
    };
    let camera = Camera {
        clear_color: ClearColorConfig::Custom(SKY),
        ..Camera::default()
    };
    let place = Transform::from_translation(CAMERA).looking_at(LOOKED_AT, Vec3::Y);
    (film, Camera3d::default(), camera, Tonemapping::None, place)
}

/// Gives a cart its body and its pole.
fn dress(add: On<Add, Cart>, shapes: Res<Shapes>, mut commands: Commands) {
    let visible = (Transform::default(), Visibility::Inherited);
    commands.entity(add.entity).insert(visible);
    let body = Transform::from_xyz(0.0, 0.5 * CART.y, 0.0).with_scale(CART);
    commands.spawn((
        ChildOf(add.entity),
        shapes.cube.clone(),
        shapes.cart.clone(),
        body,
    ));
    commands.spawn((
        ChildOf(add.entity),
        Pole,
        shapes.cube.clone(),
        shapes.pole.clone(),
        Transform::from_scale(POLE),
    ));
}

fn show_carts(mut carts: Query<(&Cart, &mut Transform)>) {
    for (cart, mut transform) in &mut carts {
        transform.translation.z = cart.position;
    }
}

fn show_poles(carts: Query<&Cart>, mut poles: Query<(&ChildOf, &mut Transform), With<Pole>>) {
    for (hinge, mut transform) in &mut poles {
        if let Ok(cart) = carts.get(hinge.parent()) {
            let rotation = Quat::from_rotation_x(cart.angle);
            transform.rotation = rotation;
            transform.translation = rotation * Vec3::new(0.0, 0.5 * POLE.y, 0.0);
        }
    }
}

/// Moves the cameras along with the carts of their worlds.
fn follow(
    carts: Query<(&Cart, &InWorld)>,
    mut cameras: Query<(&InWorld, &mut Transform), With<LudusFilmCamera>>,
) {
    for (home, mut transform) in &mut cameras {
        if let Some((cart, _)) = carts.iter().find(|(_, own)| own.0 == home.0) {
            transform.translation = CAMERA.with_z(cart.position);
        }
    }
}
