//! Turn towards a beacon: two watchers stand in the middle of each world, and know of it only what
//! their cameras show. An example of agents that see.

mod scenery;

use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_light::LightPlugin;
use bevy_ludus::camera::{Picture, RenderingPlugins};
use bevy_ludus::components::Slot;
use bevy_ludus::prelude::*;
use bevy_ludus::{Arguments, MethodResult};
use bevy_pbr::PbrPlugin;
use bevy_time::{Fixed, Time, TimePlugin};
use serde_json::json;
use std::f32::consts::{PI, TAU};
use std::time::Duration;

const TICKS_PER_SECOND: f64 = 60.0;
/// How fast a watcher turns, rad/s.
const TURNING_SPEED: f32 = 2.0;
/// A watcher that looks at the beacon this exactly has found it, rad.
const TOLERANCE: f32 = 0.07;
const NUM_WATCHERS: usize = 2;

/// Someone who stands in the middle and turns.
#[derive(Component, Default)]
struct Watcher {
    /// Direction of view, rad, counted against the clock from −z.
    heading: f32,
}

/// What the watchers of a world look for.
#[derive(Component, Default)]
struct Beacon {
    /// Where it stands, rad, counted as headings are.
    direction: f32,
    /// Red, green and blue.
    colour: [u8; 3],
}

#[derive(ActionSpace)]
enum Turn {
    Left,
    Right,
}

fn main() -> AppExit {
    let frame = Duration::from_secs_f64(1.0 / TICKS_PER_SECOND);
    App::new()
        .add_plugins(BeaconPlugin)
        .add_plugins(ScheduleRunnerPlugin::run_loop(frame))
        .add_plugins(
            LudusPlugin::default()
                .name("beacon")
                .ticks_per_step(4)
                .isolated_by(|app| {
                    app.add_plugins(BeaconPlugin);
                })
                .layout(WorldLayout::Grid),
        )
        .add_plugins(LudusTcpPlugin::default())
        .run()
}

/// The whole game, but for what runs it.
struct BeaconPlugin;

impl Plugin for BeaconPlugin {
    fn build(&self, app: &mut App) {
        let policy = Policy::new("watcher").camera("eye", Picture::rgb(48, 36));
        app.add_plugins((TaskPoolPlugin::default(), TimePlugin, RenderingPlugins))
            .add_plugins((LightPlugin, PbrPlugin::default()))
            .insert_resource(Time::<Fixed>::from_hz(TICKS_PER_SECOND))
            .init_resource::<scenery::Scenery>()
            .add_policy::<(), Turn>(policy.max_episode_steps(60))
            .add_ludus_method("state", state)
            .add_observer(scenery::fill_world)
            .add_systems(FixedUpdate, turn)
            .add_systems(Judge, judge)
            .add_systems(Observe, scenery::show)
            .add_systems(Reset, (place_beacons, place_watchers).chain());
    }
}

fn turn(time: Res<Time>, mut watchers: Query<(&mut Watcher, &Action<Turn>)>) {
    for (mut watcher, action) in &mut watchers {
        let side = match action.0 {
            Turn::Left => 1.0,
            Turn::Right => -1.0,
        };
        watcher.heading += side * TURNING_SPEED * time.delta_secs();
    }
}

/// A point for the watcher that finds the beacon; every step costs a little.
fn judge(
    mut watchers: Query<(&Watcher, &InWorld, &mut Reward, &mut Episode)>,
    beacons: Query<(&Beacon, &InWorld)>,
) {
    for (watcher, home, mut reward, mut episode) in &mut watchers {
        let beacon = beacons.iter().find(|(_, own)| *own == home);
        let is_found = beacon.is_some_and(|(beacon, _)| error_of(watcher, beacon) < TOLERANCE);
        reward.0 = -0.01;
        if is_found {
            reward.0 += 1.0;
            episode.terminate();
        }
    }
}

/// Returns by how much a watcher misses the beacon, rad.
fn error_of(watcher: &Watcher, beacon: &Beacon) -> f32 {
    ((watcher.heading - beacon.direction + PI).rem_euclid(TAU) - PI).abs()
}

fn place_beacons(mut beacons: Query<(&mut Beacon, &InWorld)>, mut worlds: Query<&mut LudusWorld>) {
    for (mut beacon, home) in &mut beacons {
        if let Ok(mut world) = worlds.get_mut(home.0)
            && world.is_beginning()
        {
            beacon.direction = world.random.range(0.0..TAU);
            beacon.colour = [(); 3].map(|()| 100 + world.random.below(156) as u8);
        }
    }
}

fn place_watchers(
    mut watchers: Query<(&mut Watcher, &Episode, &InWorld)>,
    mut worlds: Query<&mut LudusWorld>,
) {
    for (mut watcher, episode, home) in &mut watchers {
        if episode.is_beginning()
            && let Ok(mut world) = worlds.get_mut(home.0)
        {
            watcher.heading = world.random.range(0.0..TAU);
        }
    }
}

/// Tells the trainer how things stand, so that tests can compare pictures with it.
fn state(
    arguments: In<Arguments>,
    beacons: Query<(&Beacon, &InWorld)>,
    watchers: Query<(&Watcher, &Slot, &InWorld)>,
) -> MethodResult {
    let home = InWorld(arguments.world);
    let (beacon, _) = beacons
        .iter()
        .find(|(_, own)| **own == home)
        .ok_or("the world has no beacon")?;
    let mut own: Vec<_> = watchers
        .iter()
        .filter(|(_, _, own)| **own == home)
        .collect();
    own.sort_by_key(|(_, slot, _)| slot.index());
    let headings: Vec<_> = own.iter().map(|(watcher, _, _)| watcher.heading).collect();
    Ok(json!({
        "headings": headings, "direction": beacon.direction, "colour": beacon.colour
    }))
}
