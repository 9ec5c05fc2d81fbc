//! What the server knows of the game, and how clients take turns.

use super::error::Refusal;
use super::export::Export;
#[cfg(feature = "camera")]
use super::pixels::Pictures;
use super::queue::{Ask, RequestQueue};
use hyper::StatusCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tokio::sync::{Mutex, MutexGuard};
use tokio::time::{Instant, timeout_at};

/// The game, as the server sees it.
pub(super) struct GameHandle {
    pub export: Box<dyn Export>,
    pub queue: Arc<RequestQueue>,
    pub num_agents: usize,
    /// None where nothing draws.
    #[cfg(feature = "camera")]
    pub pictures: Option<Pictures>,
    timeout: Duration,
    /// Held by the client whose turn it is; the others come in order.
    turn: Mutex<()>,
    /// Requests that have not been answered yet.
    num_open: AtomicUsize,
}

/// Counts a request as open for as long as it lives.
pub(super) struct Open<'game>(&'game GameHandle);

impl Drop for Open<'_> {
    fn drop(&mut self) {
        self.0.num_open.fetch_sub(1, Ordering::Relaxed);
    }
}

impl GameHandle {
    pub fn new(
        export: Box<dyn Export>,
        queue: Arc<RequestQueue>,
        num_agents: usize,
        timeout: Duration,
    ) -> Self {
        Self {
            export,
            queue,
            num_agents,
            #[cfg(feature = "camera")]
            pictures: None,
            timeout,
            turn: Mutex::new(()),
            num_open: AtomicUsize::new(0),
        }
    }

    pub fn open(&self) -> Open<'_> {
        self.num_open.fetch_add(1, Ordering::Relaxed);
        Open(self)
    }

    pub fn has_open(&self) -> bool {
        self.num_open.load(Ordering::Relaxed) > 0
    }

    /// Lets the game do what a client asks for. No other client has a turn while the guard lives.
    ///
    /// # Errors
    /// The game did not answer in time (504), others took all the time (503), or it has ended (503).
    pub async fn play(&self, ask: Ask) -> Result<MutexGuard<'_, ()>, Refusal> {
        let deadline = Instant::now() + self.timeout;
        let Ok(turn) = timeout_at(deadline, self.turn.lock()).await else {
            return Err(self.late(
                StatusCode::SERVICE_UNAVAILABLE,
                "was busy with other clients",
            ));
        };
        let answered = self.queue.submit(ask, deadline.into_std())?;
        match timeout_at(deadline, answered).await {
            Ok(Ok(())) => Ok(turn),
            Ok(Err(_)) => Err(Refusal::ended()),
            Err(_) => Err(self.late(StatusCode::GATEWAY_TIMEOUT, "did not answer")),
        }
    }

    fn late(&self, status: StatusCode, what: &str) -> Refusal {
        let seconds = self.timeout.as_secs_f32();
        Refusal::new(
            status,
            format!(
                "the game {what} for {seconds} s\nhint: it must go to \
                 SimulationState::PausedForControl, or ask is_next_action(), to hear requests; \
                 AIGymSettings::timeout sets this time"
            ),
        )
    }
}
