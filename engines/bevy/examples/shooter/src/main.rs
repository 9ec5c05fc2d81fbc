//! Three shooters in an arena with walls hit targets that come and go: several agents per world,
//! what they see along rays, and choices of several kinds at once.

mod arena;
#[cfg(feature = "pixels")]
mod pixels;
#[cfg(feature = "view")]
mod shapes;
mod shooter;
mod sight;
mod target;
#[cfg(feature = "view")]
mod view;

use arena::{Arena, MAX_EPISODE_STEPS, NUM_SHOOTERS};
use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::{Fixed, Time, TimePlugin};
use shooter::Decision;
use std::time::Duration;

const TICKS_PER_SECOND: f64 = 30.0;
const TICKS_PER_STEP: u32 = 2;
const STEPS_PER_SECOND: f32 = TICKS_PER_SECOND as f32 / TICKS_PER_STEP as f32;

/// What the shooters see.
#[cfg(not(feature = "pixels"))]
type Seen = sight::View;
#[cfg(feature = "pixels")]
type Seen = pixels::Pixels;

/// Which of the shooters of its arena an agent is.
#[derive(Component, Clone, Copy, Debug)]
pub struct Number(usize);

fn main() -> AppExit {
    let frame = Duration::from_secs_f64(1.0 / TICKS_PER_SECOND);
    App::new()
        .add_plugins((TaskPoolPlugin::default(), TimePlugin))
        .add_plugins((ScheduleRunnerPlugin::run_loop(frame), ShooterPlugin))
        .add_plugins(
            LudusPlugin::default()
                .name("shooter")
                .ticks_per_step(TICKS_PER_STEP)
                .episode(EpisodeMode::World)
                .isolated_by(|app| {
                    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, ShooterPlugin));
                })
                .layout(WorldLayout::Grid),
        )
        .add_plugins(LudusTcpPlugin::default())
        .run()
}

/// The whole game, but for what runs it.
struct ShooterPlugin;

impl Plugin for ShooterPlugin {
    fn build(&self, app: &mut App) {
        app.insert_resource(Time::<Fixed>::from_hz(TICKS_PER_SECOND))
            .add_policy::<Seen, Decision>(policy())
            .add_observer(fill_world)
            .add_systems(Act, (decide, shoot).chain())
            .add_systems(FixedUpdate, move_shooters)
            .add_systems(Judge, (pass_step, judge).chain())
            .add_systems(Observe, observe)
            .add_systems(Reset, begin);
        #[cfg(not(feature = "pixels"))]
        app.add_sensor::<sight::Eyes, Seen>(Seen::take_rays);
        #[cfg(feature = "view")]
        app.add_plugins(view::ViewPlugin);
    }
}

/// How the shooters are trained.
fn policy() -> Policy {
    let policy = Policy::new("shooter")
        .max_episode_steps(MAX_EPISODE_STEPS)
        .setting("hidden_sizes", vec![128, 128]);
    #[cfg(feature = "pixels")]
    let policy = pixels::with_eyes(policy);
    policy
}

/// Puts an arena into each world, and an agent for each of its shooters.
fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    commands.entity(add.entity).insert(Arena::default());
    for number in 0..NUM_SHOOTERS {
        commands.spawn((
            Agent::of("shooter"),
            InWorld(add.entity),
            Number(number),
            sight::Eyes,
            Name::new(format!("shooter {number}")),
        ));
    }
}

/// Hands the decisions to the arenas.
fn decide(agents: Query<(&Action<Decision>, &Number, &InWorld)>, mut arenas: Query<&mut Arena>) {
    for (action, number, home) in &agents {
        if let Ok(mut arena) = arenas.get_mut(home.0) {
            arena.shooters[number.0].decision = action.0;
        }
    }
}

/// Shots go where their shooters looked when they decided.
fn shoot(mut arenas: Query<(&mut Arena, &mut LudusWorld)>) {
    for (mut arena, mut world) in &mut arenas {
        arena.shoot(&mut world.random);
    }
}

/// Moves everyone by one tick.
fn move_shooters(time: Res<Time>, mut arenas: Query<&mut Arena>) {
    let seconds = time.delta_secs();
    for mut arena in &mut arenas {
        arena.advance(seconds);
    }
}

fn pass_step(mut arenas: Query<(&mut Arena, &mut LudusWorld)>) {
    for (mut arena, mut world) in &mut arenas {
        arena.pass_step(&mut world.random);
    }
}

/// Rewards what was hit; ends the episode when all targets have come and gone.
fn judge(arenas: Query<&Arena>, mut agents: Query<(&Number, &InWorld, &mut Reward, &mut Episode)>) {
    for (number, home, mut reward, mut episode) in &mut agents {
        if let Ok(arena) = arenas.get(home.0) {
            reward.0 = arena.shooters[number.0].reward;
            if arena.is_over() {
                episode.terminate();
            }
        }
    }
}

/// Shows each agent its rifle; the eyes are a sensor.
fn observe(arenas: Query<&Arena>, mut agents: Query<(&Number, &InWorld, &mut Observation<Seen>)>) {
    for (number, home, mut seen) in &mut agents {
        if let Ok(arena) = arenas.get(home.0) {
            seen.0.loaded = sight::loaded(&arena.shooters[number.0]);
        }
    }
}

/// Makes the arenas of worlds whose episodes begin.
fn begin(mut arenas: Query<(&mut Arena, &mut LudusWorld)>) {
    for (mut arena, mut world) in &mut arenas {
        if world.is_beginning() {
            *arena = Arena::begin(&mut world, STEPS_PER_SECOND);
        }
    }
}
