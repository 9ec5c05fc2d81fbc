//! What a camera's entry of an observation looks like.

use crate::wire::{DType, ObservationEntry};

/// Size and colours of an agent's pictures: an entry `uint8[height, width, channels]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    width: u32,
    height: u32,
    channels: Channels,
}

/// Bytes of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Channels {
    Rgb,
    Grey,
}

/// Bytes of a pixel as the renderer gives it: red, green, blue, opacity.
const RENDERED_CHANNELS: usize = 4;

impl Picture {
    /// Describes pictures in colour, 3 bytes a pixel. Sizes are in pixels, at least 1.
    #[must_use]
    pub fn rgb(width: u32, height: u32) -> Self {
        Self::new(width, height, Channels::Rgb)
    }

    /// Describes grey pictures, 1 byte a pixel: 21 % red, 72 % green and 7 % blue, as in Godot 4.
    #[must_use]
    pub fn grey(width: u32, height: u32) -> Self {
        Self::new(width, height, Channels::Grey)
    }

    fn new(width: u32, height: u32, channels: Channels) -> Self {
        Self {
            width,
            height,
            channels,
        }
    }

    /// Returns the width, pixels.
    #[must_use]
    pub fn width(self) -> u32 {
        self.width
    }

    /// Returns the height, pixels.
    #[must_use]
    pub fn height(self) -> u32 {
        self.height
    }

    /// Returns the bytes of a pixel.
    #[must_use]
    pub fn num_channels(self) -> usize {
        match self.channels {
            Channels::Rgb => 3,
            Channels::Grey => 1,
        }
    }

    pub(crate) fn entry(self, name: &str) -> ObservationEntry {
        ObservationEntry {
            name: name.to_owned(),
            dtype: DType::Uint8,
            shape: vec![
                self.height as usize,
                self.width as usize,
                self.num_channels(),
            ],
            low: None,
            high: None,
        }
    }

    /// Writes rendered pixels, whose rows begin every `stride` bytes, into the row of an entry.
    pub(crate) fn write(self, rendered: &[u8], stride: usize, row: &mut [u8]) {
        let width = self.width as usize;
        let lines = rendered.chunks(stride);
        for (line, out) in lines.zip(row.chunks_exact_mut(width * self.num_channels())) {
            let pixels = line.as_chunks::<RENDERED_CHANNELS>().0;
            match self.channels {
                Channels::Rgb => {
                    for (pixel, out) in pixels.iter().zip(out.as_chunks_mut::<3>().0) {
                        out.copy_from_slice(&pixel[..3]);
                    }
                }
                Channels::Grey => {
                    for (pixel, out) in pixels.iter().zip(out) {
                        *out = luminance(*pixel);
                    }
                }
            }
        }
    }
}

fn luminance([red, green, blue, _]: [u8; RENDERED_CHANNELS]) -> u8 {
    let sum = 2126 * u32::from(red) + 7152 * u32::from(green) + 722 * u32::from(blue);
    ((sum + 5000) / 10_000) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    // Two lines of two pixels, padded to 12 bytes each.
    const RENDERED: [u8; 24] = [
        255, 0, 0, 9, 0, 255, 0, 9, 7, 7, 7, 7, 0, 0, 255, 9, 255, 255, 255, 9, 7, 7, 7, 7,
    ];

    #[test]
    fn colours_come_without_padding_and_opacity() {
        let mut row = [1; 12];
        Picture::rgb(2, 2).write(&RENDERED, 12, &mut row);
        assert_eq!(row, [255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255]);
    }

    #[test]
    fn grey_is_weighted() {
        let mut row = [1; 4];
        Picture::grey(2, 2).write(&RENDERED, 12, &mut row);
        assert_eq!(row, [54, 182, 18, 255]);
    }

    #[test]
    fn the_shape_is_height_width_channels() {
        assert_eq!(Picture::rgb(5, 3).entry("eye").shape, [3, 5, 3]);
        assert_eq!(Picture::grey(5, 3).entry("eye").shape, [3, 5, 1]);
    }
}
