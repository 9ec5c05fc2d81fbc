//! Pictures of a world for people, by the trainer's call `picture`.

use super::components::LudusFilmCamera;
use super::eyes::{Eyes, image_of};
use super::layers::home_of;
use super::picture::Picture;
use super::readback::Source;
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
        return Err(super::opening::NO_RENDERER.to_owned());
    }
    world.init_resource::<Eyes>();
    let films = choose(world, arguments.world);
    if films.is_empty() {
        return Err("the world has no LudusFilmCamera".to_owned());
    }
    let sources: Vec<_> = films
        .iter()
        .map(|(camera, picture)| Source {
            image: image_of(world, *camera, *picture),
            width: picture.width(),
            height: picture.height(),
        })
        .collect();
    let pictures = world.resource_scope(|world, mut eyes: Mut<Eyes>| {
        eyes.draw(world, |eyes, _, renderer| {
            let mut pictures = Vec::new();
            eyes.readback.read(renderer, &sources, |mut rendered| {
                for ((_, picture), source) in films.iter().zip(&sources) {
                    let (own, others) = rendered.split_at(source.num_bytes());
                    pictures.push(to_json(*picture, own, source.stride()));
                    rendered = others;
                }
            })?;
            Ok(pictures)
        })
    });
    for (camera, _) in films {
        set_active(world, camera, false);
    }
    Ok(pictures?.into())
}

/// Switches on the film cameras of a world, and all other cameras off.
fn choose(world: &mut World, shown: Entity) -> Vec<(Entity, Picture)> {
    let mut cameras = world.query_filtered::<(Entity, Option<&LudusFilmCamera>), With<Camera>>();
    let all: Vec<_> = cameras
        .iter(world)
        .map(|(entity, film)| {
            (
                entity,
                film.map(|film| Picture::rgb(film.width, film.height)),
            )
        })
        .collect();
    let mut films = Vec::new();
    for (camera, film) in all {
        let film = film.filter(|_| home_of(world, camera) == Some(shown));
        set_active(world, camera, film.is_some());
        films.extend(film.map(|picture| (camera, picture)));
    }
    // Queries have no order that lasts.
    let order_of = |camera| world.get::<Camera>(camera).map(|camera| camera.order);
    films.sort_by_key(|(camera, _)| (order_of(*camera), *camera));
    films
}

fn set_active(world: &mut World, camera: Entity, is_active: bool) {
    if let Some(mut camera) = world.get_mut::<Camera>(camera) {
        camera.is_active = is_active;
    }
}

fn to_json(picture: Picture, rendered: &[u8], stride: usize) -> serde_json::Value {
    let (width, height) = (picture.width(), picture.height());
    let mut rgb = vec![0; width as usize * height as usize * picture.num_channels()];
    picture.write(rendered, stride, &mut rgb);
    json!({"width": width, "height": height, "rgb": STANDARD.encode(rgb)})
}
