//! Isolated worlds: an app for each, stepped in parallel on the task pool.

use crate::advance::{WorldReset, reset_worlds};
use crate::isolated_frames::{gather, merge_specs, scatter};
use crate::opening::{Opening, open};
use crate::plugin::{IsolatedBy, build_core, run_on_one_thread};
use crate::requests::Requests;
use crate::stage::{Settings, Stage};
use crate::wire::{
    ActionFrame, ActionLayout, BatchFrame, BatchLayout, ResetAction, Spec, WorldLayout,
};
use bevy_app::{App, PluginsState, SubApp};
use bevy_ecs::prelude::*;
use bevy_tasks::{ComputeTaskPool, tick_global_task_pools_on_main_thread};
use bevy_time::TimeUpdateStrategy;
use std::sync::Mutex;

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
pub(crate) struct IsolatedApps {
    // A mutex only because apps may not be shared between threads; nobody ever waits for it.
    apps: Vec<Mutex<SubApp>>,
    settings: Settings,
    fill: IsolatedBy,
    opening: Opening,
    /// Whether a trainer takes requests.
    is_heard: bool,
    pub spec: Spec,
    pub actions: ActionFrame,
    pub batch: BatchFrame,
}

impl IsolatedApps {
    pub fn open(fill: IsolatedBy, settings: &Settings, opening: Opening) -> Result<Self, String> {
        let settings = Settings {
            is_isolated: true,
            ..settings.clone()
        };
        let apps = build_all(&fill, &settings, opening)?;
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
        })
    }

    /// Plays one step in all worlds.
    pub fn step(&mut self) -> Result<(), String> {
        let actions = &self.actions;
        for_all(&mut self.apps, |number, app| {
            scatter(actions, number, app.world_mut());
            app.update();
        });
        self.finish()
    }

    /// Resets worlds. If all get a seed their apps are made anew, with all that they hold.
    pub fn reset(&mut self, resets: &[WorldReset]) -> Result<(), String> {
        if resets.iter().all(|reset| reset.action == ResetAction::Seed) {
            let fresh = build_all(&self.fill, &self.settings, self.opening)?;
            for (own, new) in self.apps.iter_mut().zip(fresh) {
                let ticks = stage_of(own).num_ticks;
                *own = new;
                stage_of(own).num_ticks = ticks;
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

    /// Calls something on the app of one world.
    pub fn with_world<T>(
        &mut self,
        number: usize,
        function: impl FnOnce(&mut World) -> T,
    ) -> Option<T> {
        self.apps
            .get_mut(number)
            .map(|app| function(exclusive(app).world_mut()))
    }

    pub fn set_encoding(&mut self, is_encoding: bool) {
        for app in &mut self.apps {
            stage_of(app).is_encoding = is_encoding;
        }
    }

    /// Takes over what the worlds ask of the trainer.
    pub fn take_requests(&mut self, requests: &mut Requests) {
        for app in &mut self.apps {
            requests.take_over(&mut exclusive(app).world_mut().resource_mut::<Requests>());
        }
    }

    /// Lets the worlds ask things of the trainer.
    pub fn open_requests(&mut self) {
        self.is_heard = true;
        for app in &mut self.apps {
            exclusive(app).world_mut().resource_mut::<Requests>().open();
        }
    }

    /// Puts the rows of all worlds together.
    fn finish(&mut self) -> Result<(), String> {
        self.batch
            .finals
            .iter_mut()
            .for_each(crate::wire::FinalRows::clear);
        for (number, app) in self.apps.iter_mut().enumerate() {
            let world = exclusive(app).world_mut();
            let mut stage = world.resource_mut::<Stage>();
            if let Some(error) = stage.error.take() {
                return Err(format!("world {number}: {error}"));
            }
            gather(&mut stage, number, &mut self.batch);
        }
        Ok(())
    }

    /// Ticks that the worlds have had; they all have had the same number.
    pub fn num_ticks(&mut self) -> u64 {
        self.apps
            .first_mut()
            .map_or(0, |app| stage_of(app).num_ticks)
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
) -> Result<Vec<Mutex<SubApp>>, String> {
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

fn build_one(fill: &IsolatedBy, settings: &Settings, opening: Opening) -> Result<SubApp, String> {
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

pub(crate) fn exclusive(app: &mut Mutex<SubApp>) -> &mut SubApp {
    app.get_mut()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn stage_of(app: &mut Mutex<SubApp>) -> Mut<'_, Stage> {
    exclusive(app).world_mut().resource_mut::<Stage>()
}
