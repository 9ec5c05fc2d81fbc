//! The cameras of all agents look, and their pictures become entries of observations.

use super::components::{LudusCamera, LudusFilmCamera};
use super::layers::{Unsorted, separate_worlds};
use super::picture::Picture;
use super::readback::{Readback, Source};
use super::renderer::{Renderer, take_turn};
use crate::components::{Agent, Slot};
use crate::policy::{Policies, PolicyEntry};
use crate::stage::{Pass, Stage};
use bevy_asset::{AssetId, Assets};
use bevy_camera::{Camera, Projection, RenderTarget};
use bevy_ecs::entity::EntityHashSet;
use bevy_ecs::prelude::*;
use bevy_image::Image;
use bevy_render::render_resource::{TextureFormat, TextureUsages};

/// What one camera looks at in a pass, and where its picture goes.
#[derive(Clone, Copy, Debug)]
struct Gaze {
    slot: Slot,
    /// Index of the entry among all of the observation.
    entry: usize,
    picture: Picture,
    image: AssetId<Image>,
}

/// What is kept from look to look.
#[derive(Resource)]
pub(crate) struct Eyes {
    cameras: QueryState<(Entity, &'static LudusCamera)>,
    films: QueryState<(), With<LudusFilmCamera>>,
    unsorted: QueryState<(Entity, Has<Camera>), Unsorted>,
    pub readback: Readback,
}

impl FromWorld for Eyes {
    fn from_world(world: &mut World) -> Self {
        Self {
            cameras: world.query(),
            films: world.query_filtered(),
            unsorted: world.query_filtered(),
            readback: Readback::default(),
        }
    }
}

/// Lets the cameras of all agents that observe in this pass look. Without cameras, nothing happens.
pub(crate) fn look(world: &mut World) {
    if !world.contains_resource::<Renderer>() {
        return;
    }
    world.init_resource::<Eyes>();
    world.resource_scope(|world, mut eyes: Mut<Eyes>| {
        if let Err(error) = eyes.look(world) {
            world.resource_mut::<Stage>().error.get_or_insert(error);
        }
    });
}

impl Eyes {
    fn look(&mut self, world: &mut World) -> Result<(), String> {
        let has_eyes = world.resource::<Policies>().entries.iter().any(has_cameras);
        if !has_eyes && self.films.iter(world).next().is_none() {
            return Ok(());
        }
        let gazes = self.direct(world)?;
        let is_idle = gazes.is_empty() && world.resource::<Stage>().pass == Pass::Beginning;
        if is_idle {
            return Ok(());
        }
        self.draw(world, |eyes, world, renderer| {
            eyes.write(world, renderer, &gazes)
        })
    }

    /// Draws what all active cameras see, and lets a function read it.
    pub fn draw<T>(
        &mut self,
        world: &mut World,
        read: impl FnOnce(&mut Self, &mut World, &World) -> Result<T, String>,
    ) -> Result<T, String> {
        // Isolated worlds have apps of their own, and this app has none.
        let stage = world.get_resource::<Stage>();
        let worlds = stage.map_or_else(Vec::new, |stage| stage.worlds.clone());
        separate_worlds(world, &worlds, &mut self.unsorted);
        let _turn = take_turn();
        world.resource_scope(|world, mut renderer: Mut<Renderer>| {
            renderer.draw(world)?;
            read(self, world, renderer.world())
        })
    }

    /// Switches on the cameras of the agents that observe, and all others off.
    fn direct(&mut self, world: &mut World) -> Result<Vec<Gaze>, String> {
        let observers = Observers::of(world.resource::<Stage>());
        let cameras: Vec<_> = self
            .cameras
            .iter(world)
            .map(|(entity, camera)| (entity, camera.clone()))
            .collect();
        let mut gazes = Vec::with_capacity(cameras.len());
        for (entity, camera) in cameras {
            let slot = world.get::<Slot>(camera.agent).copied();
            let slot = slot.filter(|slot| observers.contains(world, camera.agent, *slot));
            set_active(world, entity, slot.is_some());
            if let Some(slot) = slot {
                let (entry, picture) = entry_of(world.resource::<Policies>(), slot, &camera)?;
                let image = image_of(world, entity, picture);
                gazes.push(Gaze {
                    slot,
                    entry,
                    picture,
                    image,
                });
            }
        }
        check_all_see(world, &observers, &gazes)?;
        Ok(gazes)
    }

    fn write(&mut self, world: &mut World, renderer: &World, gazes: &[Gaze]) -> Result<(), String> {
        let sources: Vec<_> = gazes.iter().map(|gaze| gaze.source()).collect();
        let stage = &mut *world.resource_mut::<Stage>();
        let is_encoding = stage.is_encoding;
        let (layout, bytes, _) = stage.batch.parts_mut();
        self.readback.read(renderer, &sources, |mut rendered| {
            for (gaze, source) in gazes.iter().zip(&sources).filter(|_| is_encoding) {
                let (own, others) = rendered.split_at(source.num_bytes());
                let entry = &layout.policies[gaze.slot.policy].entries[gaze.entry];
                let row = &mut bytes[entry.row(gaze.slot.index)];
                gaze.picture.write(own, source.stride(), row);
                rendered = others;
            }
        })
    }
}

impl Gaze {
    fn source(&self) -> Source {
        Source {
            image: self.image,
            width: self.picture.width(),
            height: self.picture.height(),
        }
    }
}

/// The agents that observe in this pass.
struct Observers {
    /// None: all that act.
    beginning: Option<EntityHashSet>,
}

impl Observers {
    fn of(stage: &Stage) -> Self {
        let beginning = stage.pass == Pass::Beginning;
        Self {
            beginning: beginning.then(|| stage.beginning.iter().copied().collect()),
        }
    }

    fn contains(&self, world: &World, agent: Entity, slot: Slot) -> bool {
        match &self.beginning {
            Some(beginning) => beginning.contains(&agent),
            None => world.resource::<Stage>().rosters[slot.policy].active[slot.index] == 1,
        }
    }
}

fn has_cameras(entry: &PolicyEntry) -> bool {
    !entry.policy.cameras.is_empty()
}

fn set_active(world: &mut World, entity: Entity, is_active: bool) {
    if let Some(mut camera) = world.get_mut::<Camera>(entity)
        && camera.is_active != is_active
    {
        camera.is_active = is_active;
    }
}

fn entry_of(
    policies: &Policies,
    slot: Slot,
    camera: &LudusCamera,
) -> Result<(usize, Picture), String> {
    let policy = &policies.entries[slot.policy];
    let cameras = &policy.policy.cameras;
    let found = cameras.iter().position(|(name, _)| *name == camera.entry);
    let index = found.ok_or_else(|| {
        let names: Vec<_> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        format!(
            "a LudusCamera names the entry \"{}\"; the policy {} has cameras: {}",
            camera.entry,
            policy.policy.name,
            names.join(", ")
        )
    })?;
    let first = policy.observation.len() - cameras.len();
    Ok((first + index, cameras[index].1))
}

/// Returns the image that a camera draws into; it gets one when it looks first.
pub(crate) fn image_of(world: &mut World, entity: Entity, picture: Picture) -> AssetId<Image> {
    let target = world.get::<RenderTarget>(entity);
    if let Some(image) = target.and_then(RenderTarget::as_image) {
        return image.id();
    }
    let format = TextureFormat::Rgba8UnormSrgb;
    let mut image = Image::new_target_texture(picture.width(), picture.height(), format, None);
    image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
    let image = world.resource_mut::<Assets<Image>>().add(image);
    let id = image.id();
    let mut camera = world.entity_mut(entity);
    camera.insert(RenderTarget::from(image));
    // Bevy asks a camera that it knows already for the size of its target only then.
    if let Some(mut projection) = camera.get_mut::<Projection>() {
        projection.set_changed();
    }
    id
}

/// Checks that whoever begins an episode has all its cameras.
fn check_all_see(world: &World, observers: &Observers, gazes: &[Gaze]) -> Result<(), String> {
    let Some(beginning) = &observers.beginning else {
        return Ok(());
    };
    let policies = world.resource::<Policies>();
    let expected = |agent: &Entity| {
        let slot = world.get::<Slot>(*agent)?;
        Some(policies.entries[slot.policy].policy.cameras.len())
    };
    let num_expected: usize = beginning.iter().filter_map(expected).sum();
    if num_expected == gazes.len() {
        return Ok(());
    }
    let blind = beginning.iter().find(|agent| {
        let slot = world.get::<Slot>(**agent);
        let count = slot.map_or(0, |slot| {
            gazes.iter().filter(|gaze| gaze.slot == *slot).count()
        });
        expected(agent).is_some_and(|expected| expected != count)
    });
    let policy = blind.and_then(|agent| world.get::<Agent>(*agent));
    Err(format!(
        "an agent of the policy {} has not one LudusCamera for each of its camera entries; spawn \
         it with LudusCamera::of(agent, entry)",
        policy.map_or("", |agent| agent.policy.as_str())
    ))
}
