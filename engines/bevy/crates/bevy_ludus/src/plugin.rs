//! The plugin, and what it adds to `App`.

use crate::advance::{apply_actions, begin_next, judge, observe};
use crate::methods::{Arguments, MethodResult, Methods};
use crate::play::{Play, tick};
use crate::policy::{Policies, Policy, PolicyEntry};
use crate::policy_plugin::EpisodeEnded;
use crate::requests::{Requests, TrainingStatus};
use crate::schedules::{
    Act, ControlState, Judge, LudusSystems, Observe, Reset, fit_executors_to_cores,
};
use crate::sensor::{Sensor, run_sensor};
use crate::stage::{Settings, Stage};
use crate::systems::{
    ReadActions, WriteRows, note_leaver, note_newcomer, read_actions, write_masks,
    write_observations,
};
#[cfg(feature = "trainer")]
use crate::training::{IsolatedWorlds, Pace, exchange, keep_pace};
use crate::wire::{EpisodeMode, WorldLayout};
use crate::{components, space};
use bevy_app::prelude::*;
use bevy_app::{RunFixedMainLoop, RunFixedMainLoopSystems};
use bevy_ecs::prelude::*;
use bevy_ecs::schedule::{ScheduleLabel, SingleThreadedExecutor};
use bevy_state::app::{AppExtStates, StatesPlugin};
use bevy_time::{TimePlugin, TimeSystems};
use std::sync::Arc;

/// Steps the app in lock-step with a trainer.
///
/// Add it after Bevy's own plugins. The transport is another plugin, `LudusTcpPlugin`; without it,
/// without a trainer, or without the feature `trainer`, one world plays on its own.
///
/// ```
/// # use bevy_app::prelude::*;
/// # use bevy_ludus::prelude::*;
/// App::new().add_plugins(LudusPlugin::default().name("my game").ticks_per_step(4));
/// ```
#[derive(Clone)]
pub struct LudusPlugin {
    settings: Settings,
    #[cfg_attr(not(feature = "trainer"), allow(dead_code))]
    layout: WorldLayout,
    #[cfg_attr(not(feature = "trainer"), allow(dead_code))]
    isolated_by: Option<IsolatedBy>,
}

/// Fills the app of one isolated world.
pub(crate) type IsolatedBy = Arc<dyn Fn(&mut App) + Send + Sync>;

impl Default for LudusPlugin {
    fn default() -> Self {
        let settings = Settings {
            name: String::new(),
            ticks_per_step: 1,
            episode: EpisodeMode::Agent,
            is_isolated: false,
        };
        Self {
            settings,
            layout: WorldLayout::Grid,
            isolated_by: None,
        }
    }
}

impl LudusPlugin {
    /// Names the game, for people.
    #[must_use]
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.settings.name = name.into();
        self
    }

    /// Sets how often the fixed schedule runs per decision; at least 1.
    #[must_use]
    pub fn ticks_per_step(mut self, ticks: u32) -> Self {
        self.settings.ticks_per_step = ticks.max(1);
        self
    }

    /// Sets when episodes end: each agent's by itself, or those of a world together.
    #[must_use]
    pub fn episode(mut self, mode: EpisodeMode) -> Self {
        self.settings.episode = mode;
        self
    }

    /// Says how to make an app for a single world, and with it makes the isolated layout the game's
    /// own: for games that keep their state in resources.
    ///
    /// The function adds everything that the game needs, but neither this plugin nor a transport.
    /// Worlds are stepped in parallel, each on one thread.
    #[must_use]
    pub fn isolated_by(mut self, fill: impl Fn(&mut App) + Send + Sync + 'static) -> Self {
        self.isolated_by = Some(Arc::new(fill));
        self.layout = WorldLayout::Isolated;
        self
    }

    /// Sets the layout that the game takes if the trainer does not ask for one.
    #[must_use]
    pub fn layout(mut self, layout: WorldLayout) -> Self {
        self.layout = layout;
        self
    }
}

impl Plugin for LudusPlugin {
    fn build(&self, app: &mut App) {
        build_core(app, &self.settings);
        app.add_message::<EpisodeEnded>()
            .add_systems(FixedFirst, tick.run_if(resource_exists::<Play>));
        #[cfg(feature = "trainer")]
        app.insert_resource(IsolatedWorlds::new(self.layout, self.isolated_by.clone()))
            .add_systems(
                First,
                (keep_pace.run_if(resource_exists::<Pace>), exchange)
                    .chain()
                    .in_set(LudusSystems::Exchange)
                    .before(TimeSystems),
            );
        #[cfg(not(feature = "trainer"))]
        app.add_systems(
            First,
            crate::play::start_alone
                .run_if(run_once)
                .in_set(LudusSystems::Exchange)
                .before(TimeSystems),
        );
    }

    fn finish(&self, app: &mut App) {
        fit_executors_to_cores(app.main_mut());
    }

    #[cfg(feature = "camera")]
    fn cleanup(&self, app: &mut App) {
        crate::camera::take_renderer(app);
    }
}

/// Adds what every app needs that holds worlds.
pub(crate) fn build_core(app: &mut App, settings: &Settings) {
    add_missing(app);
    app.insert_resource(settings.clone())
        .init_resource::<Policies>()
        .init_resource::<Methods>()
        .init_resource::<Requests>()
        .init_state::<ControlState>()
        .add_message::<TrainingStatus>()
        .add_observer(note_newcomer)
        .add_observer(note_leaver);
    // One system, seldom two: handing it to a thread takes longer than it runs. `edit_schedule`
    // changes that.
    make_single(app, Act);
    make_single(app, Judge);
    make_single(app, Observe);
    make_single(app, Reset);
    make_single(app, ReadActions);
    make_single(app, WriteRows);
    app.add_systems(WriteRows, write_masks.run_if(has_masks));
    add_steps(app);
    #[cfg(feature = "camera")]
    app.add_ludus_method("picture", crate::camera::picture);
}

fn add_steps(app: &mut App) {
    let before = apply_actions
        .in_set(LudusSystems::Act)
        .in_set(RunFixedMainLoopSystems::BeforeFixedMainLoop);
    let after = (
        judge.in_set(LudusSystems::Judge),
        observe.in_set(LudusSystems::Observe),
        begin_next.in_set(LudusSystems::Reset),
    )
        .chain()
        .in_set(RunFixedMainLoopSystems::AfterFixedMainLoop);
    app.add_systems(
        RunFixedMainLoop,
        (before.run_if(is_stepping), after.run_if(is_stepping)),
    )
    .add_systems(FixedFirst, count_tick.run_if(resource_exists::<Stage>));
}

fn add_missing(app: &mut App) {
    if !app.is_plugin_added::<TaskPoolPlugin>() {
        app.add_plugins(TaskPoolPlugin::default());
    }
    if !app.is_plugin_added::<TimePlugin>() {
        app.add_plugins(TimePlugin);
    }
    if !app.is_plugin_added::<StatesPlugin>() {
        app.add_plugins(StatesPlugin);
    }
}

fn make_single(app: &mut App, label: impl ScheduleLabel) {
    app.edit_schedule(label, |schedule| {
        schedule.set_executor(SingleThreadedExecutor::new());
    });
}

fn is_stepping(stage: Option<Res<Stage>>) -> bool {
    stage.is_some_and(|stage| stage.is_stepping)
}

fn has_masks(policies: Res<Policies>) -> bool {
    policies
        .entries
        .iter()
        .any(|entry| entry.policy.has_action_mask)
}

fn count_tick(mut stage: ResMut<Stage>) {
    stage.num_ticks += 1;
}

/// What Ludus adds to `App`.
pub trait LudusApp {
    /// Adds a policy whose agents see an `O` and decide an `A`. Policies come in the order in which
    /// they were added; a second one of the same name takes the place of the first.
    fn add_policy<O: space::ObservationSpace, A: space::ActionSpace>(
        &mut self,
        policy: Policy,
    ) -> &mut Self;

    /// Lets a sensor measure for all agents that have it and see an `O`, in the schedule `Observe`;
    /// `put` puts what it has measured into the observation.
    fn add_sensor<S: Sensor, O: space::ObservationSpace>(
        &mut self,
        put: fn(&mut O, S::Value),
    ) -> &mut Self;

    /// Lets the trainer call a method of the game, on a world or on an agent.
    fn add_ludus_method<M>(
        &mut self,
        name: impl Into<String>,
        system: impl IntoSystem<In<Arguments>, MethodResult, M> + 'static,
    ) -> &mut Self;
}

impl LudusApp for App {
    fn add_policy<O: space::ObservationSpace, A: space::ActionSpace>(
        &mut self,
        policy: Policy,
    ) -> &mut Self {
        let entry = PolicyEntry::new::<O, A>(policy);
        let mut policies = self.world_mut().get_resource_or_init::<Policies>();
        match policies.find(&entry.policy.name) {
            Some(index) => policies.entries[index] = entry,
            None => policies.entries.push(entry),
        }
        let is_new = |world: &mut World, marker| world.get_resource_or_init::<Seen>().add(marker);
        if is_new(
            self.world_mut(),
            std::any::TypeId::of::<components::Action<A>>(),
        ) {
            self.add_systems(ReadActions, read_actions::<A>);
        }
        if is_new(
            self.world_mut(),
            std::any::TypeId::of::<components::Observation<O>>(),
        ) {
            self.add_systems(WriteRows, write_observations::<O>);
        }
        self
    }

    fn add_sensor<S: Sensor, O: space::ObservationSpace>(
        &mut self,
        put: fn(&mut O, S::Value),
    ) -> &mut Self {
        self.add_systems(Observe, run_sensor::<S, O>(put))
    }

    fn add_ludus_method<M>(
        &mut self,
        name: impl Into<String>,
        system: impl IntoSystem<In<Arguments>, MethodResult, M> + 'static,
    ) -> &mut Self {
        let id = self.world_mut().register_system(system);
        let mut methods = self.world_mut().get_resource_or_init::<Methods>();
        methods.systems.insert(name.into(), id);
        self
    }
}

/// Types whose systems were added already.
#[derive(Resource, Default)]
struct Seen(std::collections::HashSet<std::any::TypeId>);

impl Seen {
    fn add(&mut self, marker: std::any::TypeId) -> bool {
        self.0.insert(marker)
    }
}
