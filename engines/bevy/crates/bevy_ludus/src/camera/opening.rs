//! Before training begins: can the cameras draw?

use super::error::PictureError;
use super::renderer::{Renderer, RendererMissing};
use crate::policy::Policies;
use bevy_ecs::prelude::*;
use bevy_render::renderer::RenderDevice;

/// Checks that an app that draws can, and so the cameras of its policies.
///
/// # Errors
/// They cannot.
pub(crate) fn check_renderer(world: &World) -> Result<(), PictureError> {
    if world.contains_resource::<RendererMissing>() {
        return Err(PictureError::NoRenderer);
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
        return Err(PictureError::NoRenderer);
    }
    let limit = world
        .get_resource::<RenderDevice>()
        .map_or(u32::MAX, |device| device.limits().max_texture_dimension_2d);
    let large = pictures
        .iter()
        .find(|(_, picture)| picture.width().max(picture.height()) > limit);
    large.map_or(Ok(()), |(entry, picture)| {
        Err(PictureError::TooLarge {
            entry: entry.clone(),
            width: picture.width(),
            height: picture.height(),
            limit,
        })
    })
}
