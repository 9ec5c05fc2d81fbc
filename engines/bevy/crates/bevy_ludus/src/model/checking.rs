//! Whether the parts of a model fit each other (POLICY.md §2).

use super::error::PolicyFileError;
use super::fields::{MAX_ELEMENTS, Tensor};
use super::policy_model::{
    Convolution, Distribution, ImageNetwork, Linear, Memory, PolicyModel, is_image,
};
use crate::wire::{AgentSpec, EpisodeMode, ObservationEntry, PolicySpec, Spec, WorldLayout};
use serde_json::Map;

const MAX_FRAMES: usize = 256;
const MAX_LAYERS: usize = 64;
const MAX_CONVOLUTIONS: usize = 16;
const MAX_STRIDE: usize = 1 << 16;

type Checked = Result<(), PolicyFileError>;

/// Size of what a convolution looks at or puts out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ImageSize {
    pub channels: usize,
    pub height: usize,
    pub width: usize,
}

impl ImageSize {
    /// Returns the size of an image entry; stacked frames are channels.
    pub fn of(entry: &ObservationEntry) -> Self {
        let [.., height, width, channels] = entry.shape[..] else {
            return Self {
                channels: 0,
                height: 0,
                width: 0,
            };
        };
        let frames: usize = entry.shape[..entry.shape.len() - 3].iter().product();
        Self {
            channels: channels * frames,
            height,
            width,
        }
    }

    pub fn num_elements(self) -> usize {
        self.channels * self.height * self.width
    }

    /// Returns the size of what a convolution puts out; none if its kernel does not fit.
    pub fn after(self, layer: &Convolution) -> Option<Self> {
        let [filters, _, kernel_height, kernel_width] = layer.weight.shape[..] else {
            return None;
        };
        let side = |size: usize, kernel: usize| {
            let padded = size + 2 * layer.padding;
            padded
                .checked_sub(kernel)
                .map(|free| free / layer.stride + 1)
        };
        let after = Self {
            channels: filters,
            height: side(self.height, kernel_height)?,
            width: side(self.width, kernel_width)?,
        };
        let area = after.height.checked_mul(after.width)?;
        (area.checked_mul(filters)? <= MAX_ELEMENTS).then_some(after)
    }
}

/// Checks all rules.
pub(super) fn check(model: &PolicyModel) -> Checked {
    check_spec(model)?;
    if !(1..=MAX_FRAMES).contains(&model.frames) {
        return wrong("frames", format!("1 to {MAX_FRAMES}"), model.frames);
    }
    check_normalisation(model)?;
    check_images(model)?;
    let mut size = model.num_features();
    if let Some(memory) = &model.memory {
        check_memory(memory, size)?;
        size = memory.size();
    }
    check_distribution(&model.distribution, model.bounds().count())?;
    check_layers(model, size)?;
    let total = num_elements(model);
    if total > MAX_ELEMENTS {
        let reason = format!("{total} numbers, the limit is {MAX_ELEMENTS}");
        return Err(PolicyFileError::malformed("the whole", reason));
    }
    Ok(())
}

/// Holds entries and components to the limits of the protocol, through its reader.
fn check_spec(model: &PolicyModel) -> Checked {
    let policy = PolicySpec {
        name: model.policy.clone(),
        num_agents: 1,
        agents_per_world: 1,
        episode: EpisodeMode::Agent,
        max_episode_steps: None,
        observation: model.observation.clone(),
        action: model.action.clone(),
        has_action_mask: model.has_action_mask,
        agents: vec![AgentSpec {
            world: 0,
            path: None,
        }],
        settings: Map::new(),
    };
    let spec = Spec {
        num_worlds: 1,
        layout: WorldLayout::Isolated,
        ticks_per_step: 1,
        tick_rate: 1.0,
        scene: String::new(),
        policies: vec![policy],
    };
    spec.validate().map_err(|error| {
        let text = error.to_string();
        let what = text.trim_start_matches("malformed ");
        let (place, reason) = what.split_once(": ").unwrap_or(("spec", what));
        let place = match place.strip_prefix("spec.policies[0].") {
            Some(part) => part,
            None if place.starts_with("spec.policies") => "policy",
            None => "observation",
        };
        PolicyFileError::malformed(place, reason)
    })
}

fn check_normalisation(model: &PolicyModel) -> Checked {
    let Some(normalisation) = &model.normalisation else {
        return Ok(());
    };
    let size = model.vector_size();
    check_shape("normalisation.shift", &normalisation.shift, &[size])?;
    check_shape("normalisation.scale", &normalisation.scale, &[size])?;
    let limit = normalisation.limit;
    if !(limit > 0.0 && limit.is_finite()) {
        return wrong("normalisation.limit", "a positive number", limit);
    }
    Ok(())
}

fn check_images(model: &PolicyModel) -> Checked {
    let inputs = model.inputs();
    let entries: Vec<_> = inputs.iter().filter(|entry| is_image(entry)).collect();
    let expected: Vec<_> = entries.iter().map(|entry| entry.name.as_str()).collect();
    let found: Vec<_> = model
        .images
        .iter()
        .map(|image| image.entry.as_str())
        .collect();
    if found != expected {
        return wrong(
            "images",
            format!("one for each of {expected:?}"),
            format!("{found:?}"),
        );
    }
    for (index, (image, entry)) in model.images.iter().zip(entries).enumerate() {
        check_image(&format!("images[{index}]"), image, ImageSize::of(entry))?;
    }
    Ok(())
}

fn check_image(place: &str, image: &ImageNetwork, mut size: ImageSize) -> Checked {
    let count = image.convolutions.len();
    if !(1..=MAX_CONVOLUTIONS).contains(&count) {
        return wrong(&format!("{place}.convolutions"), "1 to 16 of them", count);
    }
    for (index, layer) in image.convolutions.iter().enumerate() {
        size = check_convolution(&format!("{place}.convolutions[{index}]"), layer, size)?;
    }
    check_linear(
        &format!("{place}.linear"),
        &image.linear,
        size.num_elements(),
    )
}

/// Returns the size of the output.
fn check_convolution(
    place: &str,
    layer: &Convolution,
    size: ImageSize,
) -> Result<ImageSize, PolicyFileError> {
    let shape = &layer.weight.shape;
    let channels = size.channels;
    let expected = || format!("[filters, {channels}, kernel height, kernel width]");
    let refuse = |key: &str, expected: String| {
        let reason = format!("expected {expected}, got {shape:?}");
        Err(PolicyFileError::malformed(format!("{place}.{key}"), reason))
    };
    let [filters, inputs, height, width] = shape[..] else {
        return refuse("weight.shape", expected());
    };
    if inputs != channels || shape.contains(&0) {
        return refuse("weight.shape", expected());
    }
    if !(1..=MAX_STRIDE).contains(&layer.stride) {
        return refuse("stride", format!("1 to {MAX_STRIDE} beside a kernel"));
    }
    if layer.padding >= height.min(width) {
        return refuse("padding", "less than the kernel".to_owned());
    }
    check_shape(&format!("{place}.bias"), &layer.bias, &[filters])?;
    let fit = format!("a kernel that fits {} × {}", size.height, size.width);
    size.after(layer)
        .map_or_else(|| refuse("weight.shape", fit), Ok)
}

fn check_memory(memory: &Memory, inputs: usize) -> Checked {
    let size = memory.size();
    if size == 0 {
        let shape = &memory.weight_hidden.shape;
        return wrong(
            "memory.weight_hidden.shape",
            "[3 * size, size]",
            format!("{shape:?}"),
        );
    }
    let rows = 3 * size;
    check_shape("memory.weight_input", &memory.weight_input, &[rows, inputs])?;
    check_shape("memory.weight_hidden", &memory.weight_hidden, &[rows, size])?;
    check_shape("memory.bias_input", &memory.bias_input, &[rows])?;
    check_shape("memory.bias_hidden", &memory.bias_hidden, &[rows])
}

fn check_distribution(distribution: &Distribution, size: usize) -> Checked {
    if let Some(log_std) = &distribution.log_std {
        check_shape("distribution.log_std", log_std, &[size])?;
    }
    let range = distribution.log_std_range;
    let is_range = range[0] <= range[1] && range.iter().all(|bound| bound.is_finite());
    if !is_range {
        return wrong(
            "distribution.log_std_range",
            "[lowest, highest]",
            format!("{range:?}"),
        );
    }
    Ok(())
}

fn check_layers(model: &PolicyModel, mut size: usize) -> Checked {
    let count = model.layers.len();
    if !(1..=MAX_LAYERS).contains(&count) {
        return wrong("layers", "1 to 64 of them", count);
    }
    for (index, layer) in model.layers.iter().enumerate() {
        check_linear(&format!("layers[{index}]"), layer, size)?;
        size = layer.bias.data.len();
    }
    let expected = model.num_outputs();
    if size != expected {
        let place = format!("layers[{}].bias.shape", count - 1);
        return wrong(
            &place,
            format!("[{expected}], as action and distribution ask for"),
            size,
        );
    }
    Ok(())
}

fn check_linear(place: &str, layer: &Linear, inputs: usize) -> Checked {
    match layer.weight.shape[..] {
        [outputs, found] if outputs > 0 && found == inputs => {
            check_shape(&format!("{place}.bias"), &layer.bias, &[outputs])
        }
        _ => {
            let shape = format!("{:?}", layer.weight.shape);
            wrong(
                &format!("{place}.weight.shape"),
                format!("[outputs, {inputs}]"),
                shape,
            )
        }
    }
}

fn check_shape(place: &str, tensor: &Tensor, shape: &[usize]) -> Checked {
    if tensor.shape == shape {
        return Ok(());
    }
    let found = format!("{:?}", tensor.shape);
    wrong(&format!("{place}.shape"), format!("{shape:?}"), found)
}

fn num_elements(model: &PolicyModel) -> usize {
    let linear = |layer: &Linear| layer.weight.data.len() + layer.bias.data.len();
    let convolution = |layer: &Convolution| layer.weight.data.len() + layer.bias.data.len();
    let image = |image: &ImageNetwork| {
        linear(&image.linear) + image.convolutions.iter().map(convolution).sum::<usize>()
    };
    let memory = model.memory.as_ref().map_or(0, |memory| {
        let biases = memory.bias_input.data.len() + memory.bias_hidden.data.len();
        memory.weight_input.data.len() + memory.weight_hidden.data.len() + biases
    });
    let layers = model.layers.iter().map(linear).sum::<usize>();
    layers + model.images.iter().map(image).sum::<usize>() + memory
}

fn wrong(place: &str, expected: impl std::fmt::Display, got: impl std::fmt::Display) -> Checked {
    let reason = format!("expected {expected}, got {got}");
    Err(PolicyFileError::malformed(place, reason))
}
