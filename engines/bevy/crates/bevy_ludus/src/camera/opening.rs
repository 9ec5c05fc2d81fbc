//! Before training begins: can the cameras draw?

use super::renderer::{Renderer, RendererMissing};
use crate::policy::Policies;
use crate::trainer::Failure;
use crate::wire::ErrorCode;
use bevy_ecs::prelude::*;
use bevy_render::renderer::RenderDevice;

pub(crate) const NO_RENDERER: &str = "the game has cameras, and no renderer";

const HINT: &str = "install a renderer that works without a screen (Debian: apt install \
                    libegl1 libgl1-mesa-dri, or mesa-vulkan-drivers), add RenderingPlugins or \
                    render_plugin() of bevy_ludus::camera to the app, and disable Bevy's \
                    PipelinedRenderingPlugin";

/// Checks that an app that draws can, and so the cameras of its policies.
///
/// # Errors
/// They cannot; the trainer is told so.
pub(crate) fn check_renderer(world: &World) -> Result<(), Failure> {
    if world.contains_resource::<RendererMissing>() {
        return Err(Failure::new(ErrorCode::Renderer, NO_RENDERER, HINT));
    }
    let policies = world.get_resource::<Policies>();
    let pictures: Vec<_> = policies
        .into_iter()
        .flat_map(|policies| &policies.entries)
        .flat_map(|entry| &entry.policy.cameras)
        .collect();
    if pictures.is_empty() {
        return Ok(());
    }
    if !world.contains_resource::<Renderer>() {
        return Err(Failure::new(ErrorCode::Renderer, NO_RENDERER, HINT));
    }
    let limit = world
        .get_resource::<RenderDevice>()
        .map_or(u32::MAX, |device| device.limits().max_texture_dimension_2d);
    let large = pictures
        .iter()
        .find(|(_, picture)| picture.width().max(picture.height()) > limit);
    match large {
        None => Ok(()),
        Some((name, picture)) => {
            let (width, height) = (picture.width(), picture.height());
            let text = format!(
                "the camera entry {name} is {width} × {height} pixels; the renderer draws at most \
                 {limit} × {limit}"
            );
            Err(Failure::new(
                ErrorCode::Config,
                text,
                "make the picture smaller",
            ))
        }
    }
}
