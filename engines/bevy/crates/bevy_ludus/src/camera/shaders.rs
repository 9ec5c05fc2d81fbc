//! The shaders of a renderer: they are compiled when they are needed first, and until then what they
//! draw is missing in pictures.

use crate::error::print_error;
use bevy_ecs::prelude::*;
use bevy_render::render_resource::{
    CachedPipeline, CachedPipelineState, PipelineCache, PipelineDescriptor,
};
use bevy_render::renderer::RenderDevice;
use std::collections::HashSet;
use std::time::{Duration, Instant};

/// Shaders that are still not compiled this long after the last one belong to parts of Bevy that
/// the game lacks, or that this renderer cannot run.
const PATIENCE: Duration = Duration::from_secs(2);

/// Index of a pipeline in Bevy's cache.
type CachedPipelineId = usize;

/// What is known of a renderer's shaders.
#[derive(Debug, Default)]
pub(crate) struct Shaders {
    /// Pipelines that will not get ready.
    given_up: HashSet<CachedPipelineId>,
    /// Of the picture that is to be drawn now.
    patience: Option<Patience>,
}

impl Shaders {
    /// Returns whether the picture that was just drawn has all that it can have. If not, it is to be
    /// drawn again.
    pub fn are_ready(&mut self, renderer: &World) -> bool {
        let Some(cache) = renderer.get_resource::<PipelineCache>() else {
            return true;
        };
        let unready = self.unready(renderer, cache);
        if !unready.is_empty() {
            let patience = self.patience.get_or_insert_with(Patience::new);
            if !patience.is_over(unready.len()) {
                return false;
            }
            self.give_up(cache, unready);
        }
        self.patience = None;
        true
    }

    /// Returns the pipelines whose shaders are not compiled yet, and may still be.
    fn unready(&self, renderer: &World, cache: &PipelineCache) -> Vec<CachedPipelineId> {
        let pipelines: Vec<_> = cache.pipelines().collect();
        let may_come = can_come(renderer);
        cache
            .waiting_pipelines()
            .filter(|id| may_come(pipelines[*id]) && !self.given_up.contains(id))
            .collect()
    }

    fn give_up(&mut self, cache: &PipelineCache, unready: Vec<CachedPipelineId>) {
        let label = |pipeline: &CachedPipeline| match &pipeline.descriptor {
            PipelineDescriptor::RenderPipelineDescriptor(it) => it.label.clone(),
            PipelineDescriptor::ComputePipelineDescriptor(it) => it.label.clone(),
        };
        let pipelines = cache.pipelines().enumerate();
        let labels: Vec<_> = pipelines
            .filter(|(id, _)| unready.contains(id))
            .filter_map(|(_, pipeline)| label(pipeline))
            .collect();
        print_error(&format_args!("drawing without {}", labels.join(", ")), "");
        self.given_up.extend(unready);
    }
}

/// Returns whether a pipeline has still to be compiled, and can be. Plain OpenGL computes nothing.
fn can_come(renderer: &World) -> impl Fn(&CachedPipeline) -> bool {
    let device = renderer.get_resource::<RenderDevice>();
    let computes = device.is_some_and(|it| it.limits().max_compute_workgroups_per_dimension > 0);
    move |pipeline| {
        let is_computing = matches!(
            pipeline.descriptor,
            PipelineDescriptor::ComputePipelineDescriptor(_)
        );
        !matches!(pipeline.state, CachedPipelineState::Ok(_)) && (computes || !is_computing)
    }
}

/// How long to wait for shaders: as long as more and more get ready.
#[derive(Debug)]
struct Patience {
    num_unready: usize,
    since: Instant,
}

impl Patience {
    fn new() -> Self {
        Self {
            num_unready: usize::MAX,
            since: Instant::now(),
        }
    }

    fn is_over(&mut self, num_unready: usize) -> bool {
        if num_unready != self.num_unready {
            self.num_unready = num_unready;
            self.since = Instant::now();
        }
        self.since.elapsed() > PATIENCE
    }
}
