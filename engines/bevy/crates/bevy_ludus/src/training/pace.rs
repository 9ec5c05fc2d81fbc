//! Training that people watch: steps follow each other no faster than the game's own time passes.

use bevy_ecs::prelude::*;
use std::time::{Duration, Instant};

/// When the next step may begin.
#[derive(Resource, Debug)]
pub(crate) struct Pace {
    step: Duration,
    due: Instant,
}

impl Pace {
    /// Begins with steps of this length.
    pub fn new(step: Duration) -> Self {
        let due = Instant::now();
        Self { step, due }
    }
}

/// Sleeps until the current step is over in real time. Steps that were late are not caught up.
pub(crate) fn keep_pace(mut pace: ResMut<Pace>) {
    let now = Instant::now();
    std::thread::sleep(pace.due.saturating_duration_since(now));
    pace.due = pace.due.max(now) + pace.step;
}
