//! Isolated worlds: an app for each, stepped in parallel on the task pool.

use super::Failure;
use super::ceiling::Ceiling;
use super::host::{Host, WorldVisitor, visit_worlds};
use super::isolated_frames::{gather, merge_specs, scatter};
use crate::advance::{WorldReset, reset_worlds};
use crate::error::GameError;
use crate::link::Link;
use crate::methods::{self, CallError};
use crate::metrics::Metrics;
use crate::opening::{Opening, open};
use crate::plugin::{IsolatedBy, build_core};
use crate::requests::Requests;
use crate::schedules::run_on_one_thread;
use crate::stage::{Settings, Stage};
use crate::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchHead, BatchLayout, Call, ResetAction, Spec,
    WireError, WorldLayout,
};
use bevy_app::{App, PluginsState, SubApp};
use bevy_ecs::prelude::*;
use bevy_tasks::{ComputeTaskPool, tick_global_task_pools_on_main_thread};
use bevy_time::TimeUpdateStrategy;
use serde_json::Value;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often a thread may take new work in one step; more than once, as worlds differ.
const CHUNKS_PER_THREAD: usize = 4;

/// What the plugin was told about layouts.
#[derive(Resource, Clone)]
pub(crate) struct IsolatedWorlds {
    pub layout: WorldLayout,
    pub fill: Option<IsolatedBy>,
}

impl IsolatedWorlds {
    pub fn new(layout: WorldLayout, fill: Option<IsolatedBy>) -> Self {
        Self { layout, fill }
    }
}

/// All isolated worlds, and their common arrays.
pub(super) struct IsolatedApps {
    // A mutex only because `SubApp` is not `Sync`, which resources must be; it is never contended.
    apps: Vec<Mutex<SubApp>>,
    settings: Settings,
    fill: IsolatedBy,
    opening: Opening,
    /// Whether a trainer takes requests.
    is_heard: bool,
    spec: Spec,
    actions: ActionFrame,
    batch: BatchFrame,
    /// How long the last step of all worlds took.
    step_time: Duration,
}

impl IsolatedApps {
    pub fn open(
        fill: IsolatedBy,
        settings: &Settings,
        opening: Opening,
    ) -> Result<Self, GameError> {
        let settings = Settings {
            is_isolated: true,
            ..settings.clone()
        };
        let apps = build_all(&fill, &settings, opening)?;
        #[cfg(feature = "camera")]
        if let Some(first) = apps.first() {
            let app = first.lock().unwrap_or_else(PoisonError::into_inner);
            crate::camera::check_renderer(app.world())?;
        }
        let spec = merge_specs(&apps)?;
        Ok(Self {
            actions: ActionFrame::new(ActionLayout::new(&spec)),
            batch: BatchFrame::new(BatchLayout::new(&spec)),
            spec,
            apps,
            settings,
            fill,
            opening,
            is_heard: false,
            step_time: Duration::ZERO,
        })
    }

    /// Puts the rows of all worlds together.
    fn finish(&mut self) -> Result<(), GameError> {
        self.batch
            .finals
            .iter_mut()
            .for_each(crate::wire::FinalRows::clear);
        for (number, app) in self.apps.iter_mut().enumerate() {
            let world = exclusive(app).world_mut();
            let mut stage = world.resource_mut::<Stage>();
            if let Some(error) = stage.error.take() {
                let (world, error) = (number, Box::new(error));
                return Err(GameError::InWorld { world, error });
            }
            gather(&mut stage, number, &mut self.batch);
        }
        Ok(())
    }
}

impl Host for IsolatedApps {
    fn spec<'a>(&'a self, _: &'a World) -> &'a Spec {
        &self.spec
    }

    fn take_actions(&mut self, _: &mut World, payload: &[u8]) -> Result<(), WireError> {
        self.actions.decode(payload)?;
        for (policy, spec) in self.spec.policies.iter().enumerate() {
            let array = self.batch.layout().policies[policy].active;
            let active = &self.batch.bytes()[array.rows(0..spec.num_agents as usize)];
            self.actions.check_choices(policy, &spec.name, active)?;
        }
        Ok(())
    }

    fn draw_actions(&mut self, _: &mut World, ceiling: &mut Ceiling) -> Option<Duration> {
        ceiling.advance(&self.spec, &mut self.actions)
    }

    /// Plays the step at once, in all apps; none of its ticks is left for the one that waits.
    fn step(&mut self, _: &mut World, _: u32, _: Duration) -> Result<u32, GameError> {
        let began = Instant::now();
        let actions = &self.actions;
        for_all(&mut self.apps, |number, app| {
            scatter(actions, number, app.world_mut());
            app.update();
        });
        let finished = self.finish();
        self.step_time = began.elapsed();
        finished.map(|()| 0)
    }

    /// If all worlds get a seed, their apps are made again, with all that they hold: a game may keep
    /// its state in resources.
    fn reset(&mut self, _: &mut World, resets: &[WorldReset]) -> Result<(), GameError> {
        if resets.iter().all(|reset| reset.action == ResetAction::Seed) {
            let fresh = build_all(&self.fill, &self.settings, self.opening)?;
            for (own, new) in self.apps.iter_mut().zip(fresh) {
                let ticks = stage_of(own).num_ticks;
                let mut metrics = Metrics::default();
                visit_worlds(exclusive(own).world_mut(), &mut |_, world| {
                    metrics = std::mem::take(&mut world.metrics);
                });
                *own = new;
                stage_of(own).num_ticks = ticks;
                visit_worlds(exclusive(own).world_mut(), &mut |_, world| {
                    world.metrics = std::mem::take(&mut metrics);
                });
            }
            if self.is_heard {
                self.open_requests();
            }
        }
        for_all(&mut self.apps, |number, app| {
            reset_worlds(app.world_mut(), &resets[number..=number]);
        });
        self.finish()
    }

    /// All worlds have had the same number.
    fn num_ticks(&mut self, _: &World) -> u64 {
        self.apps
            .first_mut()
            .map_or(0, |app| stage_of(app).num_ticks)
    }

    fn send_batch(
        &mut self,
        _: &mut World,
        mut head: BatchHead,
        link: &mut Link,
    ) -> Result<(), Failure> {
        head.engine_us = self.step_time.as_micros() as u32;
        link.send(self.batch.encode(head)?)?;
        self.batch.shorten();
        Ok(())
    }

    fn set_encoding(&mut self, _: &mut World, is_encoding: bool) {
        for app in &mut self.apps {
            stage_of(app).is_encoding = is_encoding;
        }
    }

    fn for_each_world(&mut self, _: &mut World, visit: &mut WorldVisitor<'_>) {
        for app in &mut self.apps {
            visit_worlds(exclusive(app).world_mut(), visit);
        }
    }

    fn open_requests(&mut self) {
        self.is_heard = true;
        for app in &mut self.apps {
            exclusive(app).world_mut().resource_mut::<Requests>().open();
        }
    }

    fn take_requests(&mut self, requests: &mut Requests) {
        for app in &mut self.apps {
            requests.take_over(&mut exclusive(app).world_mut().resource_mut::<Requests>());
        }
    }

    fn call(&mut self, _: &mut World, call: &Call, number: usize) -> Result<Value, CallError> {
        let app = self.apps.get_mut(number);
        let app = app.ok_or(CallError::NoWorld(number))?;
        methods::call(exclusive(app).world_mut(), call, 0)
    }
}

/// Calls something on all apps, in parallel.
fn for_all(apps: &mut [Mutex<SubApp>], function: impl Fn(usize, &mut SubApp) + Send + Sync) {
    let pool = ComputeTaskPool::get();
    let chunk = apps
        .len()
        .div_ceil(pool.thread_num().max(1) * CHUNKS_PER_THREAD)
        .max(1);
    let function = &function;
    pool.scope(|scope| {
        for (index, part) in apps.chunks_mut(chunk).enumerate() {
            scope.spawn(async move {
                for (offset, app) in part.iter_mut().enumerate() {
                    function(index * chunk + offset, exclusive(app));
                }
            });
        }
    });
}

fn build_all(
    fill: &IsolatedBy,
    settings: &Settings,
    opening: Opening,
) -> Result<Vec<Mutex<SubApp>>, GameError> {
    let build = |number| {
        let first_world = opening.first_world + number as u64;
        let own = Opening {
            num_worlds: 1,
            first_world,
            ..opening
        };
        build_one(fill, settings, own).map(Mutex::new)
    };
    (0..opening.num_worlds).map(build).collect()
}

fn build_one(
    fill: &IsolatedBy,
    settings: &Settings,
    opening: Opening,
) -> Result<SubApp, GameError> {
    let mut app = App::new();
    fill(&mut app);
    build_core(&mut app, settings);
    while app.plugins_state() == PluginsState::Adding {
        tick_global_task_pools_on_main_thread();
    }
    app.finish();
    app.cleanup();
    #[cfg(feature = "camera")]
    crate::camera::take_renderer(&mut app);
    let mut app = std::mem::take(app.main_mut());
    // Worlds run beside each other, so that nothing is gained by threads within one.
    run_on_one_thread(&mut app);
    app.insert_resource(TimeUpdateStrategy::FixedTimesteps(0));
    app.update();
    open(app.world_mut(), opening)?;
    let ticks = opening.ticks_per_step.unwrap_or(settings.ticks_per_step);
    app.insert_resource(TimeUpdateStrategy::FixedTimesteps(ticks));
    Ok(app)
}

fn exclusive(app: &mut Mutex<SubApp>) -> &mut SubApp {
    app.get_mut().unwrap_or_else(PoisonError::into_inner)
}

fn stage_of(app: &mut Mutex<SubApp>) -> Mut<'_, Stage> {
    exclusive(app).world_mut().resource_mut::<Stage>()
}
