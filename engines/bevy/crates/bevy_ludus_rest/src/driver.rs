//! Which thread lets the connections move on: the game's while it waits for them, else the server's.
//!
//! A request that is handed from thread to thread costs two more wake-ups, which take longer than
//! the step of a small game. So the game's thread drives the runtime for as long as it waits. The
//! server's thread looks in from time to time, and takes over when the game stays away.

use std::future::poll_fn;
use std::pin::{Pin, pin};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use std::sync::{Arc, OnceLock};
use std::task::Poll;
use std::thread::Thread;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::sync::Notify;

/// How often the thread of the server looks whether the game still drives.
const LOOK_IN: Duration = Duration::from_millis(10);
/// How long a game in play looks for the next request before it sleeps; waking up takes longer than
/// the step of a small game. Only where a core is left for the client.
const SPIN: Duration = Duration::from_micros(200);

/// Hands the runtime, which one thread at a time can drive, from one to the other.
#[derive(Debug, Default)]
pub(super) struct RuntimeDriver {
    /// Comings and goings of the game: odd while it is here.
    visits: AtomicU64,
    is_server_driving: AtomicBool,
    is_closing: AtomicBool,
    /// Whether the last visit of the game ended with a request, so that the next is near.
    is_in_play: AtomicBool,
    called: Notify,
}

impl RuntimeDriver {
    /// Serves connections on the thread of the game until a future is done.
    ///
    /// Must not be called from within an asynchronous runtime.
    pub fn drive_until(&self, runtime: &Runtime, limit: Duration, done: impl Future<Output = ()>) {
        self.visits.fetch_add(1, SeqCst);
        if self.is_server_driving.load(SeqCst) {
            self.called.notify_one();
        }
        let is_done = runtime.block_on(async {
            let mut done = pin!(done);
            let spins = self.is_in_play.load(SeqCst) && has_spare_core();
            (spins && spin(done.as_mut()).await) || tokio::time::timeout(limit, done).await.is_ok()
        });
        self.is_in_play.store(is_done, SeqCst);
        self.visits.fetch_add(1, SeqCst);
    }

    /// Serves connections on the thread of the server whenever the game does not, until the end.
    pub fn drive_in_background(&self, runtime: &Arc<Runtime>) {
        while !self.is_closing.load(SeqCst) {
            self.is_server_driving.store(true, SeqCst);
            if self.visits.load(SeqCst).is_multiple_of(2) {
                runtime.block_on(self.called.notified());
            }
            self.is_server_driving.store(false, SeqCst);
            self.watch();
        }
    }

    /// Returns when the game has not come for a while, or at the end.
    fn watch(&self) {
        let mut seen = self.visits.load(SeqCst);
        loop {
            std::thread::park_timeout(LOOK_IN);
            let now = self.visits.load(SeqCst);
            let is_here = !now.is_multiple_of(2);
            if self.is_closing.load(SeqCst) || (now == seen && !is_here) {
                return;
            }
            seen = now;
        }
    }

    /// Lets [`RuntimeDriver::drive_in_background`] return.
    pub fn close(&self, thread: &Thread) {
        self.is_closing.store(true, SeqCst);
        self.called.notify_one();
        thread.unpark();
    }
}

fn has_spare_core() -> bool {
    // Asking takes as long as a step.
    static HAS: OnceLock<bool> = OnceLock::new();
    *HAS.get_or_init(|| std::thread::available_parallelism().is_ok_and(|cores| cores.get() > 1))
}

/// Serves connections without sleeping for a while; returns whether the future is done.
async fn spin(mut done: Pin<&mut impl Future<Output = ()>>) -> bool {
    let end = Instant::now() + SPIN;
    while Instant::now() < end {
        let is_done = poll_fn(|context| Poll::Ready(done.as_mut().poll(context).is_ready())).await;
        if is_done {
            return true;
        }
        tokio::task::yield_now().await;
    }
    false
}
