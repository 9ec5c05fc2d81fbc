//! The plugin.

use super::error::RestError;
use super::events::{EventControl, EventPause, EventReset, SimulationPauseTimer, SimulationState};
use super::export::read;
use super::game_handle::GameHandle;
#[cfg(feature = "camera")]
use super::pixels::{Pictures, add_pictures, make_targets};
use super::server::RestServer;
use super::settings::AIGymSettings;
use super::state::AIGymState;
use super::turns::{Turns, leave_initializing, pause, serve_requests};
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_ludus::schedules::{LudusSystems, fit_executors_to_cores};
use bevy_state::app::{AppExtStates, StatesPlugin};
use bevy_time::{TimePlugin, TimeSystems, TimeUpdateStrategy, Timer, TimerMode};
use serde::Serialize;
use std::marker::PhantomData;
use std::sync::Arc;

/// Shows the game to clients of bevy_rl.
///
/// Add it after Bevy's own plugins, and after the resource [`AIGymState`]. `T` is the type of
/// actions, `P` that of the state.
///
/// ```
/// # use bevy_app::prelude::*;
/// use bevy_ludus_rest::*;
///
/// let settings = AIGymSettings { num_agents: 2, port: 0, ..Default::default() };
/// let mut app = App::new();
/// app.insert_resource(AIGymState::<String, Vec<f32>>::new(settings))
///     .add_plugins(AIGymPlugin::<String, Vec<f32>>::default());
/// ```
#[derive(Clone, Debug)]
pub struct AIGymPlugin<T, P>(pub PhantomData<(T, P)>);

impl<T, P> Default for AIGymPlugin<T, P> {
    fn default() -> Self {
        Self(PhantomData)
    }
}

impl<T, P> Plugin for AIGymPlugin<T, P>
where
    T: 'static + Send + Sync + Clone,
    P: 'static + Send + Sync + Clone + Serialize,
{
    fn build(&self, app: &mut App) {
        let Some(gym) = app.world().get_resource::<AIGymState<T, P>>().cloned() else {
            refuse(app);
            return;
        };
        add_missing(app);
        let settings = read(&gym).settings.clone();
        add_turns(app, &gym, &settings);
        #[cfg(feature = "camera")]
        if settings.shows_pixels() {
            app.add_systems(PreStartup, make_targets::<T, P>);
        }
        app.add_message::<EventReset>()
            .add_message::<EventControl>()
            .add_message::<EventPause>()
            .insert_state(SimulationState::Initializing)
            .add_systems(Startup, listen::<T, P>)
            .add_systems(PostStartup, leave_initializing)
            // With a trainer, the clock is its own.
            .add_systems(
                First,
                serve_requests
                    .before(TimeSystems)
                    .before(LudusSystems::Exchange),
            )
            .add_systems(Last, pause);
    }

    fn finish(&self, app: &mut App) {
        #[cfg(feature = "camera")]
        if let Some(gym) = app.world().get_resource::<AIGymState<T, P>>().cloned() {
            let settings = read(&gym).settings.clone();
            add_pictures(app, &settings);
        }
        fit_executors_to_cores(app.main_mut());
    }
}

fn add_missing(app: &mut App) {
    if !app.is_plugin_added::<TimePlugin>() {
        app.add_plugins(TimePlugin);
    }
    if !app.is_plugin_added::<StatesPlugin>() {
        app.add_plugins(StatesPlugin);
    }
}

fn add_turns<T, P>(app: &mut App, gym: &AIGymState<T, P>, settings: &AIGymSettings)
where
    T: 'static + Send + Sync + Clone,
    P: 'static + Send + Sync + Clone,
{
    let is_lock_step = settings.is_lock_step();
    let strategy = app.world().get_resource::<TimeUpdateStrategy>();
    let is_clock_free = strategy.is_none_or(|now| matches!(now, TimeUpdateStrategy::Automatic));
    let step = (is_lock_step && is_clock_free).then(|| settings.step_time());
    let timer = Timer::new(settings.pause_every(), TimerMode::Repeating);
    app.insert_resource(Turns::new(Arc::clone(&read(gym).queue), is_lock_step, step))
        .insert_resource(SimulationPauseTimer(timer));
}

/// Begins to listen.
fn listen<T, P>(world: &mut World)
where
    T: 'static + Send + Sync + Clone,
    P: 'static + Send + Sync + Clone + Serialize,
{
    let gym = world.resource::<AIGymState<T, P>>().clone();
    let (settings, queue) = {
        let gym = read(&gym);
        (gym.settings.clone(), Arc::clone(&gym.queue))
    };
    let num_agents = settings.num_agents as usize;
    #[cfg_attr(not(feature = "camera"), allow(unused_mut))]
    let mut game = GameHandle::new(Box::new(gym), queue, num_agents, settings.wait_for_game());
    #[cfg(feature = "camera")]
    {
        game.pictures = world.get_resource::<Pictures>().cloned();
    }
    match RestServer::start(settings.port, game) {
        Ok(server) => world.insert_resource(server),
        Err(error) => {
            print_error(&error);
            world.write_message(AppExit::error());
        }
    }
}

/// Lets the app end with an error before it begins.
fn refuse(app: &mut App) {
    app.set_runner(|_| {
        print_error(&RestError::NoState);
        AppExit::error()
    });
}

#[allow(clippy::print_stderr)]
fn print_error(error: &RestError) {
    eprintln!("ludus: {error}");
}
