//! Pictures come back from the renderer: all of them in one buffer, for one wait.

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

/// Where pictures are put for the processor to read. It is kept from step to step.
#[derive(Debug, Default)]
pub(crate) struct Readback {
    buffer: Option<Buffer>,
}

/// A picture to be read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Source {
    pub image: AssetId<Image>,
    pub width: u32,
    pub height: u32,
}

impl Source {
    /// Returns how many bytes a line takes in the buffer; graphics cards want whole blocks.
    pub fn stride(self) -> usize {
        RenderDevice::align_copy_bytes_per_row(self.width as usize * PIXEL_BYTES)
    }

    /// Returns how many bytes it takes in the buffer.
    pub fn num_bytes(self) -> usize {
        self.stride() * self.height as usize
    }
}

impl Readback {
    /// Hands the bytes of all pictures, one after the other, to a function: lines of
    /// [`Source::stride`] bytes.
    ///
    /// # Errors
    /// The renderer has failed.
    pub fn read(
        &mut self,
        renderer: &World,
        sources: &[Source],
        take: impl FnOnce(&[u8]),
    ) -> Result<(), String> {
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
            let image = images.get(source.image).ok_or("a picture was not drawn")?;
            copy(&mut encoder, image, *source, buffer, offset);
            offset += source.num_bytes();
        }
        renderer
            .resource::<RenderQueue>()
            .submit([encoder.finish()]);
        let slice = buffer.slice(0..num_bytes as u64);
        let (sender, receiver) = std::sync::mpsc::channel();
        device.map_buffer(&slice, MapMode::Read, move |result| {
            // Who asked for it waits for it.
            let _ = sender.send(result);
        });
        device
            .poll(PollType::wait_indefinitely())
            .map_err(|error| format!("the renderer has failed: {error}"))?;
        match receiver.try_recv() {
            Ok(Ok(())) => take(&slice.get_mapped_range()),
            _ => return Err("the renderer has failed: it gives no pictures".into()),
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
    source: Source,
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
