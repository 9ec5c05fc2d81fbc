//! The plugin.

use super::error::RestError;
use super::events::{EventControl, EventPause, EventReset, SimulationPauseTimer, SimulationState};
use super::export::read;
use super::front::Front;
#[cfg(feature = "camera")]
use super::pixels::{Pictures, add_pictures, make_targets};
use super::server::RestServer;
use super::settings::AIGymSettings;
use super::state::AIGymState;
use super::turns::{Turns, begin, hear, pause};
use crate::plugin::run_on_one_thread;
use crate::schedules::Exchange;
use bevy_app::prelude::*;
use bevy_ecs::prelude::*;
use bevy_state::app::{AppExtStates, StatesPlugin};
use bevy_tasks::ComputeTaskPool;
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
/// use bevy_ludus::rest::*;
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
        if settings.render_to_buffer {
            app.add_systems(PreStartup, make_targets::<T, P>);
        }
        app.add_message::<EventReset>()
            .add_message::<EventControl>()
            .add_message::<EventPause>()
            .insert_state(SimulationState::Initializing)
            .add_systems(Startup, open::<T, P>)
            .add_systems(PostStartup, begin)
            // With a trainer, the clock is its own.
            .add_systems(First, hear.before(TimeSystems).before(Exchange))
            .add_systems(Last, pause);
    }

    fn finish(&self, app: &mut App) {
        #[cfg(feature = "camera")]
        if let Some(gym) = app.world().get_resource::<AIGymState<T, P>>().cloned() {
            let settings = read(&gym).settings.clone();
            add_pictures(app, &settings);
        }
        // With one thread, handing systems to it costs more than most of them take.
        if ComputeTaskPool::try_get().is_none_or(|pool| pool.thread_num() <= 1) {
            run_on_one_thread(app.main_mut());
        }
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
    app.insert_resource(Turns::new(Arc::clone(&read(gym).desk), is_lock_step, step))
        .insert_resource(SimulationPauseTimer(timer));
}

/// Begins to listen.
fn open<T, P>(world: &mut World)
where
    T: 'static + Send + Sync + Clone,
    P: 'static + Send + Sync + Clone + Serialize,
{
    let gym = world.resource::<AIGymState<T, P>>().clone();
    let (settings, desk) = {
        let gym = read(&gym);
        (gym.settings.clone(), Arc::clone(&gym.desk))
    };
    let num_agents = settings.num_agents as usize;
    #[cfg_attr(not(feature = "camera"), allow(unused_mut))]
    let mut front = Front::new(Box::new(gym), desk, num_agents, settings.wait_for_game());
    #[cfg(feature = "camera")]
    {
        front.pictures = world.get_resource::<Pictures>().cloned();
    }
    match RestServer::start(settings.port, front) {
        Ok(server) => world.insert_resource(server),
        Err(error) => {
            complain(&error);
            world.write_message(AppExit::error());
        }
    }
}

/// Lets the app end with an error before it begins.
fn refuse(app: &mut App) {
    app.set_runner(|_| {
        complain(&RestError::NoState);
        AppExit::error()
    });
}

#[allow(clippy::print_stderr)]
fn complain(error: &RestError) {
    eprintln!("ludus: {error}");
}
