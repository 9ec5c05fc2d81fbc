//! Pictures come back from the renderer: all of them in one buffer, for one wait.

use super::error::PictureError;
use super::shaders::Shaders;
use bevy_asset::AssetId;
use bevy_ecs::prelude::*;
use bevy_image::Image;
use bevy_render::render_asset::RenderAssets;
use bevy_render::render_resource::{
    Buffer, BufferDescriptor, BufferUsages, CommandEncoder, CommandEncoderDescriptor, Extent3d,
    MapMode, PollType, TexelCopyBufferInfo, TexelCopyBufferLayout,
};
use bevy_render::renderer::{RenderDevice, RenderQueue};
use bevy_render::texture::GpuImage;

/// Bytes of a rendered pixel.
const PIXEL_BYTES: usize = 4;

/// Reads images that were drawn, on the renderer's side. Keep it from picture to picture: its buffer
/// is used again.
///
/// The images must have the format `Rgba8UnormSrgb` and the usage `COPY_SRC`.
#[derive(Debug, Default)]
pub struct PictureReader {
    buffer: Option<Buffer>,
    shaders: Shaders,
}

/// An image to be read, and its size in pixels.
#[derive(Clone, Copy, Debug)]
pub struct PictureSource {
    /// The image, a target of cameras.
    pub image: AssetId<Image>,
    /// Its width, pixels.
    pub width: u32,
    /// Its height, pixels.
    pub height: u32,
}

impl PictureSource {
    /// Returns how many bytes a line takes in the buffer: graphics cards copy whole blocks of 256.
    #[must_use]
    pub fn stride(self) -> usize {
        RenderDevice::align_copy_bytes_per_row(self.width as usize * PIXEL_BYTES)
    }

    /// Returns how many bytes the image takes in the buffer.
    #[must_use]
    pub fn num_bytes(self) -> usize {
        self.stride() * self.height as usize
    }
}

impl PictureReader {
    /// Returns whether what was drawn last is complete. If not, shaders are still being compiled:
    /// draw again.
    pub fn is_complete(&mut self, renderer: &World) -> bool {
        self.shaders.are_ready(renderer)
    }

    /// Hands the bytes of all images, one after the other, to a function: lines of
    /// [`PictureSource::stride`] bytes. Blocks until the graphics card has drawn them.
    ///
    /// # Errors
    /// The renderer has failed, or an image was never drawn to.
    pub fn read(
        &mut self,
        renderer: &World,
        sources: &[PictureSource],
        take: impl FnOnce(&[u8]),
    ) -> Result<(), PictureError> {
        let num_bytes: usize = sources.iter().map(|source| source.num_bytes()).sum();
        if num_bytes == 0 {
            return Ok(());
        }
        let device = renderer.resource::<RenderDevice>();
        let buffer = self.buffer_of(device, num_bytes);
        let mut encoder = device.create_command_encoder(&CommandEncoderDescriptor::default());
        let images = renderer.resource::<RenderAssets<GpuImage>>();
        let mut offset = 0;
        for source in sources {
            let image = images.get(source.image).ok_or(PictureError::NotDrawn)?;
            copy(&mut encoder, image, *source, buffer, offset);
            offset += source.num_bytes();
        }
        renderer
            .resource::<RenderQueue>()
            .submit([encoder.finish()]);
        let slice = buffer.slice(0..num_bytes as u64);
        let (sender, receiver) = std::sync::mpsc::channel();
        device.map_buffer(&slice, MapMode::Read, move |result| {
            // The receiver lives until the end of this function, which waits for the device.
            let _ = sender.send(result);
        });
        device
            .poll(PollType::wait_indefinitely())
            .map_err(|error| PictureError::Renderer(error.to_string()))?;
        match receiver.try_recv() {
            Ok(Ok(())) => take(&slice.get_mapped_range()),
            _ => return Err(PictureError::Renderer("it gives no pictures".to_owned())),
        }
        buffer.unmap();
        Ok(())
    }

    fn buffer_of(&mut self, device: &RenderDevice, num_bytes: usize) -> &Buffer {
        let size = num_bytes as u64;
        self.buffer.take_if(|buffer| buffer.size() < size);
        self.buffer.get_or_insert_with(|| {
            device.create_buffer(&BufferDescriptor {
                label: Some("pictures of agents"),
                size,
                usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
                mapped_at_creation: false,
            })
        })
    }
}

fn copy(
    encoder: &mut CommandEncoder,
    image: &GpuImage,
    source: PictureSource,
    buffer: &Buffer,
    offset: usize,
) {
    let layout = TexelCopyBufferLayout {
        offset: offset as u64,
        bytes_per_row: Some(source.stride() as u32),
        rows_per_image: None,
    };
    let size = Extent3d {
        width: source.width,
        height: source.height,
        depth_or_array_layers: 1,
    };
    encoder.copy_texture_to_buffer(
        image.texture.as_image_copy(),
        TexelCopyBufferInfo { buffer, layout },
        size,
    );
}
