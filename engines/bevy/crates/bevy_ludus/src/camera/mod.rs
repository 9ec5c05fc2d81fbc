//! Agents that see, by the feature `camera`: what cameras see becomes `uint8` entries of
//! observations.
//!
//! A policy declares the entry ([`Policy::camera`](crate::policy::Policy::camera)), and every agent
//! gets a camera entity with a [`LudusCamera`]. Pictures show the state in which the agent observes:
//! they are drawn after the schedule `Observe`, in the same step, and also when episodes begin. For
//! that Bevy's `PostUpdate` runs each time, so that transforms are right. Every world sees itself
//! and what is in no world, and no other world, wherever they stand; entities that have
//! `RenderLayers` of their own keep them.
//!
//! No window is needed: [`RenderingPlugins`] draws with a graphics card, or in software through
//! Vulkan or OpenGL.

mod agent_cameras;
mod components;
mod error;
mod film;
mod layers;
mod opening;
mod picture;
mod readback;
mod renderer;
mod rendering;
mod shaders;

pub use agent_cameras::draw_now;
pub use components::{LudusCamera, LudusFilmCamera};
pub use error::PictureError;
pub use picture::Picture;
pub use readback::{PictureReader, PictureSource};
pub use rendering::{RenderingPlugins, render_plugin};

pub(crate) use agent_cameras::draw_observations;
pub(crate) use film::picture;
pub(crate) use opening::check_renderer;
pub(crate) use renderer::take_renderer;
