//! What the cameras of all agents see becomes entries of observations.

use super::components::{LudusCamera, LudusFilmCamera};
use super::error::PictureError;
use super::layers::{Unsorted, separate_worlds};
use super::picture::Picture;
use super::readback::{PictureReader, PictureSource};
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

/// One camera whose picture is read in a pass, and where that goes.
#[derive(Clone, Copy, Debug)]
struct CameraRead {
    slot: Slot,
    /// Index of the entry among all of the observation.
    entry: usize,
    picture: Picture,
    image: AssetId<Image>,
}

/// What is kept from pass to pass.
#[derive(Resource)]
pub(crate) struct AgentCameras {
    cameras: QueryState<(Entity, &'static LudusCamera)>,
    films: QueryState<(), With<LudusFilmCamera>>,
    unsorted: QueryState<(Entity, Has<Camera>), Unsorted>,
    pub reader: PictureReader,
}

impl FromWorld for AgentCameras {
    fn from_world(world: &mut World) -> Self {
        Self {
            cameras: world.query(),
            films: world.query_filtered(),
            unsorted: world.query_filtered(),
            reader: PictureReader::default(),
        }
    }
}

/// Draws what the cameras of the agents see that observe in this pass, and writes it into their
/// observations. Without cameras, nothing happens.
pub(crate) fn draw_observations(world: &mut World) {
    if !world.contains_resource::<Renderer>() {
        return;
    }
    world.init_resource::<AgentCameras>();
    world.resource_scope(|world, mut cameras: Mut<AgentCameras>| {
        if let Err(error) = cameras.draw_observations(world) {
            world
                .resource_mut::<Stage>()
                .error
                .get_or_insert(error.into());
        }
    });
}

impl AgentCameras {
    fn draw_observations(&mut self, world: &mut World) -> Result<(), PictureError> {
        let has_any = world.resource::<Policies>().entries.iter().any(has_cameras);
        if !has_any && self.films.iter(world).next().is_none() {
            return Ok(());
        }
        let reads = self.select(world)?;
        let is_idle = reads.is_empty() && world.resource::<Stage>().pass == Pass::Beginning;
        if is_idle {
            return Ok(());
        }
        self.draw(world, |cameras, world, renderer| {
            cameras.write(world, renderer, &reads)
        })
    }

    /// Draws what all active cameras see, and lets a function read it.
    pub fn draw<T>(
        &mut self,
        world: &mut World,
        read: impl FnOnce(&mut Self, &mut World, &World) -> Result<T, PictureError>,
    ) -> Result<T, PictureError> {
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
    fn select(&mut self, world: &mut World) -> Result<Vec<CameraRead>, PictureError> {
        let observers = Observers::of(world.resource::<Stage>());
        let cameras: Vec<_> = self
            .cameras
            .iter(world)
            .map(|(entity, camera)| (entity, camera.clone()))
            .collect();
        let mut reads = Vec::with_capacity(cameras.len());
        for (entity, camera) in cameras {
            let slot = world.get::<Slot>(camera.agent).copied();
            let slot = slot.filter(|slot| observers.contains(world, camera.agent, *slot));
            set_active(world, entity, slot.is_some());
            if let Some(slot) = slot {
                let (entry, picture) = entry_of(world.resource::<Policies>(), slot, &camera)?;
                let image = image_of(world, entity, picture);
                reads.push(CameraRead {
                    slot,
                    entry,
                    picture,
                    image,
                });
            }
        }
        check_cameras(world, &observers, &reads)?;
        Ok(reads)
    }

    fn write(
        &mut self,
        world: &mut World,
        renderer: &World,
        reads: &[CameraRead],
    ) -> Result<(), PictureError> {
        let sources: Vec<_> = reads.iter().map(|read| read.source()).collect();
        let stage = &mut *world.resource_mut::<Stage>();
        let is_encoding = stage.is_encoding;
        let (layout, bytes, _) = stage.batch.parts_mut();
        self.reader.read(renderer, &sources, |mut rendered| {
            for (read, source) in reads.iter().zip(&sources).filter(|_| is_encoding) {
                let (own, others) = rendered.split_at(source.num_bytes());
                let entry = &layout.policies[read.slot.policy].entries[read.entry];
                let row = &mut bytes[entry.row(read.slot.index)];
                read.picture.write(own, source.stride(), row);
                rendered = others;
            }
        })
    }
}

impl CameraRead {
    fn source(&self) -> PictureSource {
        PictureSource {
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
) -> Result<(usize, Picture), PictureError> {
    let policy = &policies.entries[slot.policy];
    let cameras = &policy.policy.cameras;
    let found = cameras.iter().position(|(name, _)| *name == camera.entry);
    let index = found.ok_or_else(|| {
        let names: Vec<_> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        PictureError::UnknownEntry {
            entry: camera.entry.to_string(),
            policy: policy.policy.name.clone(),
            known: names.join(", "),
        }
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

/// Checks that agents that begin an episode have all their cameras.
fn check_cameras(
    world: &World,
    observers: &Observers,
    reads: &[CameraRead],
) -> Result<(), PictureError> {
    let Some(beginning) = &observers.beginning else {
        return Ok(());
    };
    let policies = world.resource::<Policies>();
    let expected = |agent: &Entity| {
        let slot = world.get::<Slot>(*agent)?;
        Some(policies.entries[slot.policy].policy.cameras.len())
    };
    let num_expected: usize = beginning.iter().filter_map(expected).sum();
    if num_expected == reads.len() {
        return Ok(());
    }
    let incomplete = beginning.iter().find(|agent| {
        let slot = world.get::<Slot>(**agent);
        let count = slot.map_or(0, |slot| {
            reads.iter().filter(|read| read.slot == *slot).count()
        });
        expected(agent).is_some_and(|expected| expected != count)
    });
    let agent = incomplete.and_then(|agent| world.get::<Agent>(*agent));
    let policy = agent.map_or_else(String::new, |agent| agent.policy.clone());
    Err(PictureError::MissingCamera(policy))
}

/// Draws what all active cameras see now, in an app whose renderer `LudusPlugin` drives, and lets a
/// function read it from the world of the renderer (with a [`PictureReader`]).
///
/// Bevy itself draws once, after an update; this is for crates that need pictures at another time.
///
/// # Errors
/// The app has no renderer, or it has failed, or the function fails.
pub fn draw_now<T>(
    world: &mut World,
    read: impl FnOnce(&World) -> Result<T, PictureError>,
) -> Result<T, PictureError> {
    if !world.contains_resource::<Renderer>() {
        return Err(PictureError::NoRenderer);
    }
    world.init_resource::<AgentCameras>();
    world.resource_scope(|world, mut cameras: Mut<AgentCameras>| {
        cameras.draw(world, |_, _, renderer| read(renderer))
    })
}
