use bevy_app::prelude::*;
use bevy_app::{ScheduleRunnerPlugin, TaskPoolPlugin};
use bevy_ecs::prelude::*;
use bevy_ludus::prelude::*;
use bevy_time::TimePlugin;

/// What an agent sees: field names become entry names.
#[derive(ObservationSpace)]
struct Seen {
    #[ludus(low = -1.0, high = 1.0)]
    position: f32,
    #[ludus(low = -1.0, high = 1.0)]
    flag: f32,
}

/// What it decides: here one choice of three. A struct may have several choices and numbers.
#[derive(ActionSpace)]
enum Run {
    Stay,
    Left,
    Right,
}

#[derive(Component, Default)]
struct Runner {
    position: f32,
    flag: f32,
}

fn main() -> AppExit {
    App::new()
        .add_plugins((TaskPoolPlugin::default(), TimePlugin, ScheduleRunnerPlugin::default()))
        .add_plugins(RunnerPlugin)
        .add_plugins(
            LudusPlugin::default()
                .name("runner")
                .ticks_per_step(4)
                .isolated_by(|app| {
                    app.add_plugins((TaskPoolPlugin::default(), TimePlugin, RunnerPlugin));
                })
                .layout(WorldLayout::Grid),
        )
        .add_plugins(LudusTcpPlugin::default())
        .run()
}

/// The game itself.
struct RunnerPlugin;

impl Plugin for RunnerPlugin {
    fn build(&self, app: &mut App) {
        app.add_policy::<Seen, Run>(Policy::new("runner").max_episode_steps(100))
            .add_observer(fill_world)
            .add_systems(FixedUpdate, run)
            .add_systems(Judge, judge)
            .add_systems(Observe, observe)
            .add_systems(Reset, begin);
    }
}

/// Ludus spawns worlds; the game puts into each what belongs there.
fn fill_world(add: On<Add, LudusWorld>, mut commands: Commands) {
    commands.spawn((Agent::of("runner"), InWorld(add.entity), Runner::default()));
}

/// Every tick: the action stays the same during all ticks of a step.
fn run(mut runners: Query<(&mut Runner, &Action<Run>)>) {
    for (mut runner, action) in &mut runners {
        runner.position += match action.0 {
            Run::Stay => 0.0,
            Run::Left => -0.01,
            Run::Right => 0.01,
        };
    }
}

/// Once per step, after its ticks.
fn judge(mut runners: Query<(&Runner, &mut Reward, &mut Episode)>) {
    for (runner, mut reward, mut episode) in &mut runners {
        let distance = (runner.flag - runner.position).abs();
        reward.0 = -0.1 * distance;
        if distance < 0.05 {
            reward.0 = 1.0;
            episode.terminate();
        }
    }
}

fn observe(mut runners: Query<(&Runner, &mut Observation<Seen>)>) {
    for (runner, mut seen) in &mut runners {
        seen.0 = Seen { position: runner.position.clamp(-1.0, 1.0), flag: runner.flag };
    }
}

/// When episodes begin. All randomness comes from the world.
fn begin(mut runners: Query<(&mut Runner, &Episode, &InWorld)>, mut worlds: Query<&mut LudusWorld>) {
    for (mut runner, episode, home) in &mut runners {
        if episode.is_beginning()
            && let Ok(mut world) = worlds.get_mut(home.0)
        {
            *runner = Runner { position: 0.0, flag: world.random.range(-0.9..0.9) };
        }
    }
}
