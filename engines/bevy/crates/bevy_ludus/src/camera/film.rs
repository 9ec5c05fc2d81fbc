//! Pictures of a world for people, by the trainer's call `picture`.

use super::agent_cameras::{AgentCameras, image_of};
use super::components::LudusFilmCamera;
use super::error::PictureError;
use super::layers::home_of;
use super::picture::Picture;
use super::readback::PictureSource;
use super::renderer::Renderer;
use crate::methods::{Arguments, MethodResult};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use bevy_camera::Camera;
use bevy_ecs::prelude::*;
use serde_json::json;

/// Returns what the film cameras of a world see: a list of objects with `width`, `height` and
/// `rgb`, the pixels line by line, three bytes each, in base64.
pub(crate) fn picture(arguments: In<Arguments>, world: &mut World) -> MethodResult {
    if !world.contains_resource::<Renderer>() {
        return Err(PictureError::NoRenderer.to_string());
    }
    world.init_resource::<AgentCameras>();
    let Choice { films, others } = choose(world, arguments.world);
    if films.is_empty() {
        return Err("the world has no LudusFilmCamera".to_owned());
    }
    let cameras: Vec<_> = films.iter().map(|(camera, _)| *camera).collect();
    set_active(world, &cameras, true);
    set_active(world, &others, false);
    let sources: Vec<_> = films
        .iter()
        .map(|(camera, picture)| PictureSource {
            image: image_of(world, *camera, *picture),
            width: picture.width(),
            height: picture.height(),
        })
        .collect();
    let pictures = world.resource_scope(|world, mut drawing: Mut<AgentCameras>| {
        drawing.draw(world, |drawing, _, renderer| {
            let mut pictures = Vec::new();
            drawing.reader.read(renderer, &sources, |mut rendered| {
                for ((_, picture), source) in films.iter().zip(&sources) {
                    let (own, others) = rendered.split_at(source.num_bytes());
                    pictures.push(to_json(*picture, own, source.stride()));
                    rendered = others;
                }
            })?;
            Ok(pictures)
        })
    });
    set_active(world, &cameras, false);
    set_active(world, &others, true);
    let pictures = pictures.map_err(|error| error.to_string())?;
    Ok(pictures.into())
}

/// Cameras for a picture of a world.
struct Choice {
    films: Vec<(Entity, Picture)>,
    /// All others that are switched on.
    others: Vec<Entity>,
}

fn choose(world: &mut World, shown: Entity) -> Choice {
    let mut cameras = world.query::<(Entity, &Camera, Option<&LudusFilmCamera>)>();
    let (mut films, mut others) = (Vec::new(), Vec::new());
    for (entity, camera, film) in cameras.iter(world) {
        match film.filter(|_| home_of(world, entity) == Some(shown)) {
            Some(film) => films.push((entity, Picture::rgb(film.width, film.height))),
            None if camera.is_active => others.push(entity),
            None => {}
        }
    }
    // Queries have no order that lasts.
    let order_of = |camera| world.get::<Camera>(camera).map(|camera| camera.order);
    films.sort_by_key(|(camera, _)| (order_of(*camera), *camera));
    Choice { films, others }
}

fn set_active(world: &mut World, cameras: &[Entity], is_active: bool) {
    for camera in cameras {
        if let Some(mut camera) = world.get_mut::<Camera>(*camera) {
            camera.is_active = is_active;
        }
    }
}

fn to_json(picture: Picture, rendered: &[u8], stride: usize) -> serde_json::Value {
    let (width, height) = (picture.width(), picture.height());
    let mut rgb = vec![0; width as usize * height as usize * picture.num_channels()];
    picture.write(rendered, stride, &mut rgb);
    json!({"width": width, "height": height, "rgb": STANDARD.encode(rgb)})
}
