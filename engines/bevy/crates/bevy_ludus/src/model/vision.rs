//! What a policy makes of an image (POLICY.md §3.2). Channels lie together, pixel by pixel, so that
//! whole rows of a kernel's window are copied at once.

use super::checking::ImageSize;
use super::dense::Dense;
use super::policy_model::{Convolution, ImageNetwork};
use crate::wire::ObservationEntry;

/// Windows that are computed together, unless they are large.
const MAX_WINDOWS: usize = 16;
const MAX_WINDOW_ELEMENTS: usize = 1 << 16;

/// The network of an image.
#[derive(Clone, Debug)]
pub(super) struct Vision {
    size: ImageSize,
    frames: usize,
    layers: Vec<Layer>,
    linear: Dense,
    windows: Vec<f32>,
    front: Vec<f32>,
    back: Vec<f32>,
}

#[derive(Clone, Debug)]
struct Layer {
    dense: Dense,
    input: ImageSize,
    output: ImageSize,
    kernel_width: usize,
    stride: usize,
    padding: usize,
}

impl Vision {
    /// Packs a network that was checked.
    pub fn new(network: &ImageNetwork, entry: &ObservationEntry) -> Self {
        let size = ImageSize::of(entry);
        let mut layers: Vec<Layer> = Vec::new();
        let mut input = size;
        for layer in &network.convolutions {
            let layer = Layer::new(layer, input);
            input = layer.output;
            layers.push(layer);
        }
        let largest = layers.iter().map(|layer| layer.output.num_elements());
        let buffer = vec![0.0; largest.fold(size.num_elements(), usize::max)];
        let windows = layers
            .iter()
            .map(|layer| layer.num_windows() * layer.dense.inputs);
        Self {
            frames: entry.shape[..entry.shape.len() - 3].iter().product(),
            linear: flat(network, input),
            windows: vec![0.0; windows.max().unwrap_or(0)],
            front: buffer.clone(),
            back: buffer,
            layers,
            size,
        }
    }

    /// Returns the number of features.
    pub fn num_features(&self) -> usize {
        self.linear.outputs
    }

    /// Computes the features of one image, `[frames…, height, width, channels]`.
    pub fn run(&mut self, pixels: &[u8], features: &mut [f32]) {
        self.unpack(pixels);
        for layer in &self.layers {
            layer.run(&self.front, &mut self.windows, &mut self.back);
            std::mem::swap(&mut self.front, &mut self.back);
        }
        self.linear.run(&self.front[..self.linear.inputs], features);
    }

    /// Divides bytes by 255 and puts the frames of each channel together.
    fn unpack(&mut self, pixels: &[u8]) {
        let area = self.size.height * self.size.width;
        let channels = self.size.channels / self.frames;
        for (frame, pixels) in pixels.chunks_exact(area * channels).enumerate() {
            let target = self.front.chunks_exact_mut(self.size.channels);
            for (target, pixel) in target.zip(pixels.chunks_exact(channels)) {
                for (channel, byte) in pixel.iter().enumerate() {
                    target[channel * self.frames + frame] = f32::from(*byte) / 255.0;
                }
            }
        }
    }
}

impl Layer {
    fn new(layer: &Convolution, input: ImageSize) -> Self {
        let (kernel_height, kernel_width) = (layer.weight.shape[2], layer.weight.shape[3]);
        let channels = input.channels;
        let num_inputs = kernel_height * kernel_width * channels;
        let weight = |filter: usize, place: usize| {
            let (pixel, channel) = (place / channels, place % channels);
            let start = (filter * channels + channel) * kernel_height * kernel_width;
            layer.weight.data[start + pixel]
        };
        Self {
            dense: Dense::pack(&layer.bias.data, num_inputs, layer.activation, weight),
            output: input.after(layer).unwrap_or(input),
            input,
            kernel_width,
            stride: layer.stride,
            padding: layer.padding,
        }
    }

    fn num_windows(&self) -> usize {
        (MAX_WINDOW_ELEMENTS / self.dense.inputs).clamp(1, MAX_WINDOWS)
    }

    fn run(&self, image: &[f32], windows: &mut [f32], output: &mut [f32]) {
        let num_pixels = self.output.height * self.output.width;
        let filters = self.output.channels;
        for first in (0..num_pixels).step_by(self.num_windows()) {
            let count = self.num_windows().min(num_pixels - first);
            let windows = &mut windows[..count * self.dense.inputs];
            for (pixel, window) in (first..).zip(windows.chunks_exact_mut(self.dense.inputs)) {
                self.copy_window(image, pixel, window);
            }
            let output = &mut output[first * filters..(first + count) * filters];
            self.dense.run(windows, output);
        }
    }

    /// Copies what the kernel looks at for one pixel of the output; zeros outside of the image.
    fn copy_window(&self, image: &[f32], pixel: usize, window: &mut [f32]) {
        let top = pixel / self.output.width * self.stride;
        let left = pixel % self.output.width * self.stride;
        // How many columns of the window are cut off on the left, and where those on the right begin.
        let skipped = self.padding.saturating_sub(left).min(self.kernel_width);
        let end = (self.input.width + self.padding)
            .saturating_sub(left)
            .clamp(skipped, self.kernel_width);
        let channels = self.input.channels;
        for (row, line) in window
            .chunks_exact_mut(self.kernel_width * channels)
            .enumerate()
        {
            let inside = (top + row).checked_sub(self.padding);
            let Some(y) = inside.filter(|y| *y < self.input.height && skipped < end) else {
                line.fill(0.0);
                continue;
            };
            let x = left + skipped - self.padding;
            let start = (y * self.input.width + x) * channels;
            let seen = &image[start..start + (end - skipped) * channels];
            line[..skipped * channels].fill(0.0);
            line[skipped * channels..end * channels].copy_from_slice(seen);
            line[end * channels..].fill(0.0);
        }
    }
}

/// Packs the last layer, whose weights come filter by filter.
fn flat(network: &ImageNetwork, input: ImageSize) -> Dense {
    let (weight, bias) = (&network.linear.weight.data, &network.linear.bias.data);
    let (inputs, channels) = (input.num_elements(), input.channels);
    let area = input.height * input.width;
    Dense::pack(bias, inputs, network.linear.activation, |output, place| {
        let (pixel, channel) = (place / channels, place % channels);
        weight[output * inputs + channel * area + pixel]
    })
}
