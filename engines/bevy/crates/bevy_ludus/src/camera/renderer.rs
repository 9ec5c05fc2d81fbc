//! Bevy's renderer, drawing when it is told to.

use crate::plugin::run_on_one_thread;
use bevy_app::{App, PostUpdate, SubApp};
use bevy_asset::handle_internal_asset_events;
use bevy_ecs::prelude::*;
use bevy_light::cluster::GlobalClusterSettings;
use bevy_render::error_handler::{RenderError, RenderErrorHandler, RenderErrorPolicy};
use bevy_render::render_resource::{
    CachedPipeline, CachedPipelineState, PipelineCache, PipelineDescriptor,
};
use bevy_render::renderer::RenderDevice;
use bevy_render::{RenderApp, RenderPlugin};
use bevy_tasks::ComputeTaskPool;
use bevy_time::TimeReceiver;
use std::collections::HashSet;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Shaders that are not compiled so long after others were are those of parts of Bevy that the
/// game, or this renderer, has not.
const SHADER_PATIENCE: Duration = Duration::from_secs(2);
/// Pause between two looks at whether they are.
const SHADER_PAUSE: Duration = Duration::from_millis(1);

/// Index of a pipeline in Bevy's cache.
type CachedPipelineId = usize;

/// The renderer, taken out of the app: Bevy would draw once after every update, and agents need
/// pictures in the middle of one.
#[derive(Resource)]
pub(crate) struct Renderer {
    // A mutex only because apps may not be shared between threads; nobody ever waits for it.
    app: Mutex<SubApp>,
    /// Pipelines that will not get ready.
    given_up: HashSet<CachedPipelineId>,
}

/// Held while something is drawn and read.
static DRAWING: Mutex<()> = Mutex::new(());

/// Waits for the renderers of other apps. Isolated worlds run on several threads, and Mesa's OpenGL
/// crashes when several contexts draw at once.
pub(crate) fn take_turn() -> MutexGuard<'static, ()> {
    DRAWING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Takes the renderer out of an app, when all plugins have been set up.
pub(crate) fn take_renderer(app: &mut App) {
    if let Some(mut renderer) = app.remove_sub_app(RenderApp) {
        if ComputeTaskPool::try_get().is_none_or(|pool| pool.thread_num() <= 1) {
            run_on_one_thread(&mut renderer);
        }
        if let Some(mut clusters) = app.world_mut().get_resource_mut::<GlobalClusterSettings>() {
            // The graphics card sizes its clusters by what earlier frames needed, so that the first
            // ones may be wrong.
            clusters.gpu_clustering = None;
        }
        // It would be sent the time of each picture, and panic when there are several an update.
        app.world_mut().remove_resource::<TimeReceiver>();
        app.init_resource::<RenderFailure>()
            .insert_resource(RenderErrorHandler(note_failure))
            .insert_resource(Renderer {
                app: Mutex::new(renderer),
                given_up: HashSet::new(),
            });
    } else if app.is_plugin_added::<RenderPlugin>() {
        app.init_resource::<RendererMissing>();
    }
}

/// The app has Bevy's plugins for drawing, and they found nothing to draw with. Some of them panic
/// then as soon as something that is drawn is despawned.
#[derive(Resource, Debug, Default)]
pub(crate) struct RendererMissing;

/// What has gone wrong in the renderer; empty if nothing has.
#[derive(Resource, Debug, Default)]
struct RenderFailure(String);

/// Keeps an error for the trainer. Bevy itself would end the game.
fn note_failure(error: &RenderError, world: &mut World, _: &mut World) -> RenderErrorPolicy {
    let text = format!(
        "the renderer has failed: {:?}: {}",
        error.ty, error.description
    );
    world.insert_resource(RenderFailure(text));
    RenderErrorPolicy::StopRendering
}

impl Renderer {
    /// Draws what all active cameras see, as things stand.
    ///
    /// # Errors
    /// The renderer has failed.
    pub fn draw(&mut self, world: &mut World) -> Result<(), String> {
        let mut patience = Patience::new();
        loop {
            self.draw_once(world)?;
            let unready = self.unready();
            if unready.is_empty() {
                return Ok(());
            }
            if patience.is_over(unready.len()) {
                self.give_up(unready);
                return Ok(());
            }
            // They are loaded by tasks, which tell the app's own server of assets.
            sleep(SHADER_PAUSE);
            handle_internal_asset_events(world);
        }
    }

    /// Returns the world of the renderer.
    pub fn world(&mut self) -> &World {
        self.app().world()
    }

    fn draw_once(&mut self, world: &mut World) -> Result<(), String> {
        let is_run = world.try_run_schedule(PostUpdate);
        debug_assert!(is_run.is_ok(), "every app has it");
        let app = self.app();
        app.extract(world);
        app.update();
        let failure = &world.resource::<RenderFailure>().0;
        if failure.is_empty() {
            Ok(())
        } else {
            Err(failure.clone())
        }
    }

    /// Returns the pipelines whose shaders are not compiled yet, and may still be.
    fn unready(&mut self) -> Vec<CachedPipelineId> {
        let given_up = std::mem::take(&mut self.given_up);
        let renderer = self.app().world();
        let unready = renderer
            .get_resource::<PipelineCache>()
            .map_or_else(Vec::new, |cache| {
                let pipelines: Vec<_> = cache.pipelines().collect();
                let may_come = can_come(renderer);
                cache
                    .waiting_pipelines()
                    .filter(|id| may_come(pipelines[*id]) && !given_up.contains(id))
                    .collect()
            });
        self.given_up = given_up;
        unready
    }

    #[allow(clippy::print_stderr)]
    fn give_up(&mut self, unready: Vec<CachedPipelineId>) {
        let cache = self.app().world().resource::<PipelineCache>();
        let label = |pipeline: &CachedPipeline| match &pipeline.descriptor {
            PipelineDescriptor::RenderPipelineDescriptor(it) => it.label.clone(),
            PipelineDescriptor::ComputePipelineDescriptor(it) => it.label.clone(),
        };
        let pipelines = cache.pipelines().enumerate();
        let labels: Vec<_> = pipelines
            .filter(|(id, _)| unready.contains(id))
            .filter_map(|(_, pipeline)| label(pipeline))
            .collect();
        eprintln!("ludus: drawing without {}", labels.join(", "));
        self.given_up.extend(unready);
    }

    fn app(&mut self) -> &mut SubApp {
        self.app.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns whether a pipeline has still to be compiled, and can be. Plain OpenGL computes nothing.
fn can_come(renderer: &World) -> impl Fn(&CachedPipeline) -> bool {
    let device = renderer.get_resource::<RenderDevice>();
    let computes = device.is_some_and(|it| it.limits().max_compute_workgroups_per_dimension > 0);
    move |pipeline| {
        let is_computing = matches!(
            pipeline.descriptor,
            PipelineDescriptor::ComputePipelineDescriptor(_)
        );
        !matches!(pipeline.state, CachedPipelineState::Ok(_)) && (computes || !is_computing)
    }
}

/// How long to wait for shaders: as long as more and more get ready.
struct Patience {
    num_unready: usize,
    since: Instant,
}

impl Patience {
    fn new() -> Self {
        Self {
            num_unready: usize::MAX,
            since: Instant::now(),
        }
    }

    fn is_over(&mut self, num_unready: usize) -> bool {
        if num_unready != self.num_unready {
            self.num_unready = num_unready;
            self.since = Instant::now();
        }
        self.since.elapsed() > SHADER_PATIENCE
    }
}
