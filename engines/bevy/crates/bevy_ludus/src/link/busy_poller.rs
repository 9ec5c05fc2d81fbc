//! When to poll a socket without sleeping, and when to leave the core to others.

use std::time::{Duration, Instant};

/// Two polls are this far apart only if the core was taken away between them.
const AWAY: Duration = Duration::from_millis(1);
/// This many misses within [`MISS_WINDOW`] mean nothing: updates, or the system's own work.
const MAX_MISSES: u32 = 5;
const MISS_WINDOW: Duration = Duration::from_millis(100);
/// How long this side does not poll after that; it doubles each time the core is soon lost again.
const FIRST_BACKOFF: Duration = Duration::from_millis(100);
const LONGEST_BACKOFF: Duration = Duration::from_secs(1);

/// How polling went lately (PROTOCOL.md §10, `spin_us`).
///
/// Where another process wants the core, perhaps the very one that is waited for, polling costs
/// milliseconds a message: each side polls in vain until the scheduler takes the core away from it.
/// After six empty or interrupted polls, this side sleeps at once for 0.1 s, doubling up to 1 s.
#[derive(Debug, Default)]
pub(super) struct BusyPoller {
    first_miss: Option<Instant>,
    num_misses: u32,
    backoff: Duration,
    backoff_until: Option<Instant>,
}

impl BusyPoller {
    /// Returns whether the core is left to others now.
    pub fn is_backing_off(&self, now: Instant) -> bool {
        self.backoff_until.is_some_and(|until| now < until)
    }

    /// Returns whether the core was taken away between two polls.
    pub fn was_away(before: Instant, now: Instant) -> bool {
        now - before > AWAY
    }

    /// Records a poll that found nothing, or lost the core meanwhile.
    pub fn record_miss(&mut self, now: Instant) {
        if self
            .first_miss
            .is_none_or(|since| now - since > MISS_WINDOW)
        {
            self.first_miss = Some(now);
            self.num_misses = 0;
        }
        self.num_misses += 1;
        if self.num_misses > MAX_MISSES {
            let is_soon = self
                .backoff_until
                .is_some_and(|until| now - until < LONGEST_BACKOFF);
            let longer = if is_soon {
                2 * self.backoff
            } else {
                Duration::ZERO
            };
            self.backoff = longer.clamp(FIRST_BACKOFF, LONGEST_BACKOFF);
            self.backoff_until = Some(now + self.backoff);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: Duration = Duration::from_millis(1);

    /// Misses this many times, with a pause before each; returns when the last was over.
    fn miss(poller: &mut BusyPoller, mut now: Instant, count: u32, pause: Duration) -> Instant {
        for _ in 0..count {
            now += pause;
            poller.record_miss(now);
        }
        now
    }

    /// Asserts how long the backoff takes; returns when it is over.
    fn end_of_backoff(poller: &BusyPoller, now: Instant, milliseconds: u32) -> Instant {
        let end = now + milliseconds * MILLISECOND;
        assert!(poller.is_backing_off(end - MILLISECOND));
        assert!(!poller.is_backing_off(end));
        end
    }

    #[test]
    fn six_misses_at_once_begin_a_backoff() {
        let mut poller = BusyPoller::default();
        let now = miss(&mut poller, Instant::now(), 6, 15 * MILLISECOND);
        end_of_backoff(&poller, now, 100);
    }

    #[test]
    fn a_backoff_doubles_where_the_core_is_soon_lost_again() {
        let mut poller = BusyPoller::default();
        let mut now = Instant::now();
        for milliseconds in [100, 200, 400, 800, 1000, 1000] {
            now = miss(&mut poller, now, 6, 15 * MILLISECOND);
            now = end_of_backoff(&poller, now, milliseconds);
        }
        now = miss(&mut poller, now + 1000 * MILLISECOND, 6, 15 * MILLISECOND);
        end_of_backoff(&poller, now, 100);
    }

    #[test]
    fn five_misses_at_once_begin_no_backoff() {
        let mut poller = BusyPoller::default();
        let now = miss(&mut poller, Instant::now(), 5, 15 * MILLISECOND);
        assert!(!poller.is_backing_off(now));
    }

    #[test]
    fn a_miss_now_and_then_begins_no_backoff() {
        let mut poller = BusyPoller::default();
        let now = miss(&mut poller, Instant::now(), 20, 30 * MILLISECOND);
        assert!(!poller.is_backing_off(now));
    }

    #[test]
    fn the_core_was_away_where_a_millisecond_is_missing() {
        let now = Instant::now();
        assert!(!BusyPoller::was_away(now, now + MILLISECOND));
        assert!(BusyPoller::was_away(now, now + 2 * MILLISECOND));
    }
}
