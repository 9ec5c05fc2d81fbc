//! Bevy's renderer, which draws on demand.

use super::error::PictureError;
use super::shaders::Shaders;
use crate::error::print_error;
use crate::schedules::fit_executors_to_cores;
use bevy_app::{App, AppExit, Last, PostUpdate, SubApp};
use bevy_asset::handle_internal_asset_events;
use bevy_ecs::prelude::*;
use bevy_light::cluster::GlobalClusterSettings;
use bevy_render::error_handler::{RenderError, RenderErrorHandler, RenderErrorPolicy};
use bevy_render::{RenderApp, RenderPlugin};
use bevy_time::TimeReceiver;
use bevy_window::Window;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::sleep;
use std::time::Duration;

/// Pause between two looks at whether shaders are compiled.
const SHADER_PAUSE: Duration = Duration::from_millis(1);

/// The renderer, taken out of the app: Bevy would draw once after every update, and agents need
/// pictures in the middle of one.
#[derive(Resource)]
pub(crate) struct Renderer {
    // A mutex only because `SubApp` is not `Sync`, which resources must be; it is never contended.
    app: Mutex<SubApp>,
    shaders: Shaders,
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
        fit_executors_to_cores(&mut renderer);
        if let Some(mut clusters) = app.world_mut().get_resource_mut::<GlobalClusterSettings>() {
            // The graphics card sizes its clusters by what earlier frames needed, so that the first
            // ones may be wrong.
            clusters.gpu_clustering = None;
        }
        // It would be sent the time of each picture, and panic when there are several an update.
        app.world_mut().remove_resource::<TimeReceiver>();
        app.init_resource::<RenderFailure>()
            .add_systems(Last, draw_windows.run_if(any_with_component::<Window>))
            .insert_resource(RenderErrorHandler(note_failure))
            .insert_resource(Renderer {
                app: Mutex::new(renderer),
                shaders: Shaders::default(),
            });
    } else if app.is_plugin_added::<RenderPlugin>() {
        app.init_resource::<RendererMissing>();
    }
}

/// The app has Bevy's plugins for drawing, and they found nothing to draw with. Some of them panic
/// then as soon as something that is drawn is despawned.
#[derive(Resource, Debug, Default)]
pub(crate) struct RendererMissing;

/// What has gone wrong in the renderer.
#[derive(Resource, Debug, Default)]
struct RenderFailure(Option<PictureError>);

/// Keeps an error for the trainer. Bevy itself would end the game.
fn note_failure(error: &RenderError, world: &mut World, _: &mut World) -> RenderErrorPolicy {
    let text = format!("{:?}: {}", error.ty, error.description);
    world.insert_resource(RenderFailure(Some(PictureError::Renderer(text))));
    RenderErrorPolicy::StopRendering
}

/// Draws what windows show, at the end of an update, as Bevy itself would.
fn draw_windows(world: &mut World) {
    let _turn = take_turn();
    world.resource_scope(|world, mut renderer: Mut<Renderer>| renderer.draw_as_it_is(world));
    if let Some(error) = &world.resource::<RenderFailure>().0 {
        print_error(error, "");
        world.write_message(AppExit::error());
    }
}

impl Renderer {
    /// Draws what all active cameras see, as things stand.
    ///
    /// # Errors
    /// The renderer has failed.
    pub fn draw(&mut self, world: &mut World) -> Result<(), PictureError> {
        loop {
            self.draw_once(world)?;
            let app = self.app.get_mut().unwrap_or_else(PoisonError::into_inner);
            if self.shaders.are_ready(app.world()) {
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

    fn draw_once(&mut self, world: &mut World) -> Result<(), PictureError> {
        let is_run = world.try_run_schedule(PostUpdate);
        debug_assert!(is_run.is_ok(), "every app has it");
        self.draw_as_it_is(world);
        let failure = world.resource::<RenderFailure>().0.clone();
        failure.map_or(Ok(()), Err)
    }

    fn draw_as_it_is(&mut self, world: &mut World) {
        let app = self.app();
        app.extract(world);
        app.update();
    }

    fn app(&mut self) -> &mut SubApp {
        self.app.get_mut().unwrap_or_else(PoisonError::into_inner)
    }
}
