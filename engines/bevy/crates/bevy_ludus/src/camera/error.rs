//! Why there are no pictures.

use thiserror::Error;

/// What is wrong with a game's cameras, or with what draws for them.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum PictureError {
    /// Nothing on this machine can draw, or the app lacks Bevy's plugins for it.
    #[error("the game has cameras, and no renderer")]
    NoRenderer,
    /// The renderer reports an error.
    #[error("the renderer has failed: {0}")]
    Renderer(String),
    /// An image is not the target of a camera that drew.
    #[error("a picture was not drawn")]
    NotDrawn,
    /// An entry is larger than the renderer's largest texture.
    #[error(
        "the camera entry {entry} is {width} × {height} pixels; the renderer draws at most \
         {limit} × {limit}"
    )]
    TooLarge {
        /// Name of the entry.
        entry: String,
        /// Its width, pixels.
        width: u32,
        /// Its height, pixels.
        height: u32,
        /// Largest width and height, pixels.
        limit: u32,
    },
    /// A camera names an entry that its agent's policy does not have.
    #[error("a LudusCamera names the entry \"{entry}\"; the policy {policy} has cameras: {known}")]
    UnknownEntry {
        /// What the camera names.
        entry: String,
        /// The policy of its agent.
        policy: String,
        /// The policy's camera entries.
        known: String,
    },
    /// An agent that begins an episode lacks a camera, or has one twice.
    #[error(
        "an agent of the policy {0} has not one LudusCamera for each of its camera entries; spawn it \
         with LudusCamera::of(agent, entry)"
    )]
    MissingCamera(String),
}

impl PictureError {
    pub(crate) fn hint(&self) -> &'static str {
        match self {
            Self::NoRenderer => {
                "install a renderer that works without a screen (Debian: apt install libegl1 \
                 libgl1-mesa-dri, or mesa-vulkan-drivers), add RenderingPlugins or render_plugin() \
                 of bevy_ludus::camera to the app, and disable Bevy's PipelinedRenderingPlugin"
            }
            Self::TooLarge { .. } => "make the picture smaller",
            _ => "",
        }
    }
}
