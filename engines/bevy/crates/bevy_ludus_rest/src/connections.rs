//! Connections of clients: how many there may be, which has to go for a new one, and how long a
//! request may take to arrive.

use hyper::rt::ReadBufCursor;
use hyper_util::rt::TokioIo;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::task::AbortHandle;
use tokio::time::{Instant, sleep_until};

const MAX_CONNECTIONS: usize = 64;
/// How long a request may take from its first byte to its last; on one machine it takes
/// milliseconds. A client that is silent between requests may be so for as long as it likes.
pub(super) const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// What a connection does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Nothing, since then.
    Idle(Instant),
    /// A request arrives, since then.
    Receiving(Instant),
    /// A whole request has come, and is answered.
    Answering,
}

#[derive(Debug)]
struct Progress {
    phase: Phase,
    /// Whether it has ever sent a whole request.
    is_known: bool,
}

/// One connection, as its own task and the others see it.
#[derive(Debug)]
pub(super) struct Connection {
    progress: Mutex<Progress>,
    begun: Notify,
}

impl Connection {
    fn new() -> Self {
        Self {
            progress: Mutex::new(Progress {
                phase: Phase::Idle(Instant::now()),
                is_known: false,
            }),
            begun: Notify::new(),
        }
    }

    fn progress(&self) -> MutexGuard<'_, Progress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn note_bytes(&self) {
        let mut progress = self.progress();
        if matches!(progress.phase, Phase::Idle(_)) {
            progress.phase = Phase::Receiving(Instant::now());
            self.begun.notify_one();
        }
    }

    /// Notes that a request is whole.
    pub fn note_request(&self) {
        let mut progress = self.progress();
        progress.phase = Phase::Answering;
        progress.is_known = true;
    }

    /// Notes that a request was answered.
    pub fn note_answer(&self) {
        self.progress().phase = Phase::Idle(Instant::now());
    }

    /// Returns when the request that arrives now must be whole.
    pub fn deadline(&self) -> Instant {
        let began = match self.progress().phase {
            Phase::Receiving(since) => since,
            Phase::Idle(_) | Phase::Answering => Instant::now(),
        };
        began + REQUEST_TIMEOUT
    }

    /// Resolves when a request has taken too long to arrive.
    pub async fn overdue(&self) {
        loop {
            let phase = self.progress().phase;
            match phase {
                Phase::Receiving(since) => {
                    sleep_until(since + REQUEST_TIMEOUT).await;
                    if self.progress().phase == phase {
                        return;
                    }
                }
                Phase::Idle(_) | Phase::Answering => self.begun.notified().await,
            }
        }
    }
}

/// A socket that notes when a request begins.
pub(super) struct WatchedStream {
    stream: TokioIo<TcpStream>,
    connection: Arc<Connection>,
}

impl WatchedStream {
    pub fn new(stream: TcpStream, connection: Arc<Connection>) -> Self {
        let stream = TokioIo::new(stream);
        Self { stream, connection }
    }
}

impl hyper::rt::Read for WatchedStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: ReadBufCursor<'_>,
    ) -> Poll<io::Result<()>> {
        let read = Pin::new(&mut self.stream).poll_read(context, buffer);
        if read.is_ready() {
            self.connection.note_bytes();
        }
        read
    }
}

impl hyper::rt::Write for WatchedStream {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(context, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffers: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(context, buffers)
    }
}

/// All connections that are open.
#[derive(Debug, Default)]
pub(super) struct Connections {
    open: Vec<(Arc<Connection>, AbortHandle)>,
}

impl Connections {
    /// Makes room for one more. If there is none, a connection is closed: first those that have
    /// never sent a whole request, of these the one that has done nothing for the longest time.
    /// Returns whether there is room; not so while all are being answered.
    pub fn make_room(&mut self) -> bool {
        self.open.retain(|(_, task)| !task.is_finished());
        if self.open.len() < MAX_CONNECTIONS {
            return true;
        }
        let ranked = self
            .open
            .iter()
            .enumerate()
            .filter_map(|(index, (connection, _))| {
                let progress = connection.progress();
                match progress.phase {
                    Phase::Idle(since) | Phase::Receiving(since) => {
                        Some((progress.is_known, since, index))
                    }
                    Phase::Answering => None,
                }
            });
        let Some((_, _, index)) = ranked.min() else {
            return false;
        };
        self.open.swap_remove(index).1.abort();
        true
    }

    /// Serves a connection in a task of the current runtime.
    pub fn spawn<F>(&mut self, serve: impl FnOnce(Arc<Connection>) -> F)
    where
        F: Future<Output = ()> + Send + 'static,
    {
        let connection = Arc::new(Connection::new());
        let task = tokio::spawn(serve(Arc::clone(&connection)));
        self.open.push((connection, task.abort_handle()));
    }
}
