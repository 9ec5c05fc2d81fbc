//! Bevy's plugins that a game without a window needs to draw.

use bevy_app::{PluginGroup, PluginGroupBuilder};
use bevy_asset::AssetPlugin;
use bevy_core_pipeline::CorePipelinePlugin;
use bevy_diagnostic::FrameCountPlugin;
use bevy_image::ImagePlugin;
use bevy_mesh::MeshPlugin;
use bevy_render::RenderPlugin;
use bevy_render::settings::{RenderCreation, WgpuSettings, WgpuSettingsPriority};
use bevy_transform::TransformPlugin;
use bevy_window::{ExitCondition, WindowPlugin};

/// Everything that cameras need, without a window: what `DefaultPlugins` of the crate `bevy` would
/// add, up to the plugins for what is drawn (`LightPlugin` and `PbrPlugin`, `SpriteRenderPlugin`,
/// …), which the game adds itself.
///
/// ```no_run
/// # use bevy_app::prelude::*;
/// # use bevy_ludus::prelude::*;
/// # use bevy_ludus::camera::RenderingPlugins;
/// App::new().add_plugins((RenderingPlugins, LudusPlugin::default()));
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct RenderingPlugins;

impl PluginGroup for RenderingPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>()
            .add(FrameCountPlugin)
            .add(TransformPlugin)
            .add(WindowPlugin {
                primary_window: None,
                exit_condition: ExitCondition::DontExit,
                ..WindowPlugin::default()
            })
            .add(AssetPlugin::default())
            .add(render_plugin())
            .add(ImagePlugin::default())
            .add(MeshPlugin)
            .add(bevy_camera::CameraPlugin)
            .add(CorePipelinePlugin)
    }
}

/// Makes Bevy's plugin for rendering in a way that serves agents: what is drawn is complete in its
/// first picture; and where nothing can draw, the game ends with an error that says so instead of
/// panicking.
///
/// With `DefaultPlugins`, use `.set(render_plugin())`, and disable `PipelinedRenderingPlugin`.
#[must_use]
pub fn render_plugin() -> RenderPlugin {
    let mut settings = WgpuSettings::default();
    match find_backend(&settings) {
        None => settings.backends = None,
        // Some of the shaders that Bevy compiles for OpenGL with all its features are refused by
        // drivers; those for the plainer OpenGL of browsers are not.
        Some(wgpu::Backend::Gl) => {
            settings.priority = WgpuSettingsPriority::WebGL2;
            settings.limits = wgpu::Limits::downlevel_webgl2_defaults();
        }
        Some(_) => {}
    }
    RenderPlugin {
        render_creation: RenderCreation::Automatic(Box::new(settings)),
        synchronous_pipeline_compilation: true,
        ..RenderPlugin::default()
    }
}

/// Returns through what this machine draws, with a graphics card or in software; none if it cannot.
fn find_backend(settings: &WgpuSettings) -> Option<wgpu::Backend> {
    let backends = settings.backends?;
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = backends;
    descriptor.flags = settings.instance_flags;
    let instance = wgpu::Instance::new(descriptor);
    let options = wgpu::RequestAdapterOptions {
        power_preference: settings.power_preference,
        force_fallback_adapter: settings.force_fallback_adapter,
        compatible_surface: None,
    };
    let adapter = bevy_tasks::block_on(instance.request_adapter(&options)).ok()?;
    Some(adapter.get_info().backend)
}
