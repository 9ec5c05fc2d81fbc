//! Each world is seen by its own cameras alone, by Bevy's render layers.

use crate::world::InWorld;
use bevy_camera::Camera;
use bevy_camera::visibility::{RenderLayers, ViewVisibility};
use bevy_ecs::entity::EntityHashMap;
use bevy_ecs::prelude::*;

/// What is in no world, such as a sun, is in this layer and seen by all.
const SHARED: usize = 0;

/// Cameras, and what they may see, that have no layer yet.
pub(crate) type Unsorted = (
    Without<RenderLayers>,
    Or<(With<ViewVisibility>, With<Camera>)>,
);

/// Puts everything that has no layer of its own into the layer of its world. Cameras see their
/// world and what all worlds share. A single world needs no layer: all cameras see all of it, also
/// those of windows, which are in no world.
pub(crate) fn separate_worlds(
    world: &mut World,
    worlds: &[Entity],
    unsorted: &mut QueryState<(Entity, Has<Camera>), Unsorted>,
) {
    if worlds.len() < 2 {
        return;
    }
    let found: Vec<_> = unsorted.iter(world).collect();
    if found.is_empty() {
        return;
    }
    let layers: EntityHashMap<usize> = worlds
        .iter()
        .enumerate()
        .map(|(number, entity)| (*entity, SHARED + 1 + number))
        .collect();
    for (entity, is_camera) in found {
        let home = home_of(world, entity);
        let Some(own) = home.and_then(|home| layers.get(&home)) else {
            continue;
        };
        world.entity_mut(entity).insert(if is_camera {
            RenderLayers::from_layers(&[SHARED, *own])
        } else {
            RenderLayers::from_layers(&[*own])
        });
    }
}

/// Finds the world that an entity, or what it hangs on, is in.
pub(crate) fn home_of(world: &World, entity: Entity) -> Option<Entity> {
    let mut entity = entity;
    loop {
        if let Some(home) = world.get::<InWorld>(entity) {
            return Some(home.0);
        }
        entity = world.get::<ChildOf>(entity)?.parent();
    }
}
