//! Pictures for clients: what the cameras of all agents see, side by side in one PNG.
//!
//! A picture is drawn when a client asks for it, by the renderer that draws the game anyway; the game
//! stands still meanwhile. Where `LudusPlugin` has taken the renderer, which then draws only when it
//! is told to, it is told to.

use super::error::Refusal;
use super::export::read;
use super::settings::AIGymSettings;
use super::state::AIGymState;
use bevy_app::{App, Last};
use bevy_asset::{AssetId, Assets};
use bevy_ecs::prelude::*;
use bevy_image::Image;
use bevy_ludus::LudusPlugin;
use bevy_ludus::camera::{PictureError, PictureReader, PictureSource, draw_now};
use bevy_render::render_resource::{TextureFormat, TextureUsages};
use bevy_render::{Render, RenderApp, RenderSystems};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How long to wait for targets that the renderer has not yet.
const TARGET_PATIENCE: Duration = Duration::from_secs(2);
const FORMAT: TextureFormat = TextureFormat::Rgba8UnormSrgb;

/// What the game, its renderer and the server share of pictures.
#[derive(Clone, Resource)]
pub(super) struct Pictures(Arc<Mutex<Order>>);

/// An order for a picture, and what has come of it.
struct Order {
    width: u32,
    height: u32,
    targets: Vec<AssetId<Image>>,
    wanted_since: Option<Instant>,
    taken: Option<Result<Vec<u8>, PictureError>>,
    reader: PictureReader,
}

impl Pictures {
    fn order(&self) -> MutexGuard<'_, Order> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has a picture drawn.
    pub fn want(&self) {
        let mut order = self.order();
        order.taken = None;
        order.wanted_since = Some(Instant::now());
    }

    fn is_wanted(&self) -> bool {
        self.order().wanted_since.is_some()
    }

    /// Returns whether the picture that was wanted is there.
    pub fn is_taken(&self) -> bool {
        self.order().taken.is_some()
    }

    /// Returns the picture as a PNG.
    ///
    /// # Errors
    /// The renderer has failed.
    pub fn png(&self) -> Result<Vec<u8>, Refusal> {
        let mut order = self.order();
        let (width, height) = (order.width, order.height);
        let num_agents = order.targets.len() as u32;
        let taken = order.taken.take().unwrap_or(Err(PictureError::NotDrawn));
        drop(order);
        let pixels = taken.map_err(|error| Refusal::game(error.to_string()))?;
        encode(&pixels, width * num_agents, height)
            .map_err(|error| Refusal::game(format!("the picture is not a PNG: {error}")))
    }
}

/// Makes one target per agent for the game's cameras, before its startup systems run.
pub(super) fn make_targets<A, B>(
    gym: Res<AIGymState<A, B>>,
    images: Option<ResMut<Assets<Image>>>,
    pictures: Option<Res<Pictures>>,
) where
    A: 'static + Send + Sync + Clone,
    B: 'static + Send + Sync + Clone,
{
    let Some(mut images) = images else { return };
    let mut gym = read(&gym);
    let AIGymSettings {
        width,
        height,
        num_agents,
        ..
    } = gym.settings;
    for _ in 0..num_agents {
        let mut image = Image::new_target_texture(width.max(1), height.max(1), FORMAT, None);
        image.texture_descriptor.usage |= TextureUsages::COPY_SRC;
        gym.render_image_handles.push(images.add(image));
    }
    if let Some(pictures) = pictures {
        pictures.order().targets = gym.render_image_handles.iter().map(|it| it.id()).collect();
    }
}

/// Lets the renderer of an app take pictures, if it has one and they are wanted.
pub(super) fn add_pictures(app: &mut App, settings: &AIGymSettings) {
    if !settings.shows_pixels() {
        return;
    }
    let order = Order {
        width: settings.width.max(1),
        height: settings.height.max(1),
        targets: Vec::new(),
        wanted_since: None,
        taken: None,
        reader: PictureReader::default(),
    };
    let pictures = Pictures(Arc::new(Mutex::new(order)));
    let is_driven = app.is_plugin_added::<LudusPlugin>();
    let Some(renderer) = app.get_sub_app_mut(RenderApp) else {
        return;
    };
    if is_driven {
        app.add_systems(Last, draw);
    } else {
        renderer
            .insert_resource(pictures.clone())
            .add_systems(Render, take.in_set(RenderSystems::Cleanup));
    }
    app.insert_resource(pictures);
}

/// At the end of an update, when Bevy would draw: has the picture drawn that is wanted, and takes it.
fn draw(world: &mut World) {
    let pictures = world.resource::<Pictures>().clone();
    if !pictures.is_wanted() {
        return;
    }
    let result = draw_now(world, |renderer| pictures.order().read(renderer));
    pictures.order().give(result);
}

/// In the renderer, after it has drawn: takes the picture that is wanted.
fn take(renderer: &World) {
    let mut order = renderer.resource::<Pictures>().order();
    let Some(since) = order.wanted_since else {
        return;
    };
    if !order.reader.is_complete(renderer) {
        return;
    }
    let result = order.read(renderer);
    if result.is_ok() || since.elapsed() > TARGET_PATIENCE {
        order.give(result);
    }
}

impl Order {
    fn give(&mut self, result: Result<Vec<u8>, PictureError>) {
        self.wanted_since = None;
        self.taken = Some(result);
    }

    /// Reads the pictures of all agents into one, from left to right.
    fn read(&mut self, renderer: &World) -> Result<Vec<u8>, PictureError> {
        let (width, height) = (self.width, self.height);
        let source = |image: &AssetId<Image>| PictureSource {
            image: *image,
            width,
            height,
        };
        let sources: Vec<_> = self.targets.iter().map(source).collect();
        let line = width as usize * 4;
        let mut pixels = vec![0; line * sources.len() * height as usize];
        self.reader.read(renderer, &sources, |bytes| {
            let mut pictures = bytes;
            for (agent, source) in sources.iter().enumerate() {
                let (picture, rest) = pictures.split_at(source.num_bytes());
                pictures = rest;
                for (row, from) in picture.chunks_exact(source.stride()).enumerate() {
                    let start = (row * sources.len() + agent) * line;
                    pixels[start..start + line].copy_from_slice(&from[..line]);
                }
            }
        })?;
        Ok(pixels)
    }
}

fn encode(pixels: &[u8], width: u32, height: u32) -> Result<Vec<u8>, png::EncodingError> {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.write_header()?.write_image_data(pixels)?;
    Ok(png)
}
