//! The desk between clients and game: one request waits, one is being worked on.

use super::error::Refusal;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{Notify, oneshot};

/// What a client wants of the game.
#[derive(Debug)]
pub(super) enum Ask {
    Step(Vec<Option<String>>),
    Reset,
    #[cfg_attr(not(feature = "camera"), allow(dead_code))]
    Picture,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Step,
    Reset,
    Picture,
}

impl Ask {
    fn kind(&self) -> Kind {
        match self {
            Self::Step(_) => Kind::Step,
            Self::Reset => Kind::Reset,
            Self::Picture => Kind::Picture,
        }
    }
}

#[derive(Debug)]
struct Waiting {
    ask: Ask,
    reply: oneshot::Sender<()>,
    deadline: Instant,
}

/// What the game works on. It is kept when its client has gone, as the game knows nothing of that.
#[derive(Debug)]
struct Current {
    kind: Kind,
    reply: oneshot::Sender<()>,
    deadline: Instant,
    has_result: bool,
}

#[derive(Debug, Default)]
struct Papers {
    waiting: Option<Waiting>,
    current: Option<Current>,
    is_closed: bool,
}

/// Passes requests to the game, and its answers back.
#[derive(Debug)]
pub(super) struct Desk {
    papers: Mutex<Papers>,
    /// For a game that waits for clients: on its own, or as it serves them.
    came: Condvar,
    called: Notify,
    /// In lock-step an answer goes out when the game stands still again.
    is_lock_step: bool,
}

impl Papers {
    /// Returns the request that the game may begin with.
    fn next(&self) -> Option<&Ask> {
        let is_free = self
            .current
            .as_ref()
            .is_none_or(|current| current.deadline <= Instant::now());
        let waiting = self
            .waiting
            .as_ref()
            .filter(|waiting| !waiting.reply.is_closed());
        waiting.filter(|_| is_free).map(|waiting| &waiting.ask)
    }

    fn answer(&mut self) {
        if let Some(current) = self.current.take() {
            // The client may have gone.
            let _ = current.reply.send(());
        }
    }
}

impl Desk {
    pub fn new(is_lock_step: bool) -> Self {
        Self {
            papers: Mutex::default(),
            came: Condvar::new(),
            called: Notify::new(),
            is_lock_step,
        }
    }

    fn papers(&self) -> MutexGuard<'_, Papers> {
        self.papers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lays a request on the desk; the receiver hears when the game has done it.
    ///
    /// # Errors
    /// The game has ended.
    pub fn submit(&self, ask: Ask, deadline: Instant) -> Result<oneshot::Receiver<()>, Refusal> {
        let (reply, answered) = oneshot::channel();
        let mut papers = self.papers();
        if papers.is_closed {
            return Err(Refusal::ended());
        }
        // Clients take turns: what lay here has been given up.
        papers.waiting = Some(Waiting {
            ask,
            reply,
            deadline,
        });
        drop(papers);
        self.came.notify_all();
        self.called.notify_one();
        Ok(answered)
    }

    /// Returns whether a request of a kind waits for the game.
    pub fn is_waiting(&self, kind: Kind) -> bool {
        self.papers().next().is_some_and(|ask| ask.kind() == kind)
    }

    /// Returns whether the game can do nothing but wait for a client.
    pub fn is_idle(&self) -> bool {
        let papers = self.papers();
        papers.current.is_none() && papers.next().is_none() && !papers.is_closed
    }

    /// Takes a request of a kind from the desk: the game works on it from now on.
    pub fn take(&self, kind: Kind) -> Option<Ask> {
        let mut papers = self.papers();
        papers.next().filter(|ask| ask.kind() == kind)?;
        let Waiting {
            ask,
            reply,
            deadline,
        } = papers.waiting.take()?;
        papers.current = Some(Current {
            kind,
            reply,
            deadline,
            has_result: false,
        });
        Some(ask)
    }

    /// The game says that it has done what it was asked for.
    pub fn note_result(&self, kind: Kind) {
        let mut papers = self.papers();
        let Some(current) = papers
            .current
            .as_mut()
            .filter(|current| current.kind == kind)
        else {
            return;
        };
        current.has_result = true;
        if !self.is_lock_step {
            papers.answer();
        }
    }

    /// The game stands still: what it has done is answered, and so is what it ran for.
    pub fn finish(&self, has_run: bool) {
        let mut papers = self.papers();
        let is_done = |current: &Current| {
            let has_played = has_run && current.kind != Kind::Picture;
            current.has_result || has_played || current.deadline <= Instant::now()
        };
        if papers.current.as_ref().is_some_and(is_done) {
            papers.answer();
        }
    }

    /// Resolves when a request waits.
    pub async fn arrival(&self) {
        while self.papers().next().is_none() {
            self.called.notified().await;
        }
    }

    /// Blocks until a request waits, for some time.
    pub fn wait(&self, limit: Duration) {
        let papers = self.papers();
        let is_quiet = |papers: &mut Papers| papers.next().is_none() && !papers.is_closed;
        drop(self.came.wait_timeout_while(papers, limit, is_quiet));
    }

    /// Ends all that is under way: what has a result is answered, the rest is refused.
    pub fn close(&self) {
        let mut papers = self.papers();
        papers.is_closed = true;
        papers.waiting = None;
        if papers
            .current
            .as_ref()
            .is_some_and(|current| current.has_result)
        {
            papers.answer();
        }
        papers.current = None;
    }
}
