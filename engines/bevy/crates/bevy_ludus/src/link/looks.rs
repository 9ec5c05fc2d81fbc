//! When to look for data without sleeping, and when to leave the core to others.

use std::time::{Duration, Instant};

/// A look that lasts longer hardly pays; on a core that others want, it lasts for milliseconds.
const LONG: Duration = Duration::from_millis(2);
/// Long looks within [`LONG_LOOKS`] that mean nothing: an update, or the system's own work.
const MAX_LONG: u32 = 2;
const LONG_LOOKS: Duration = Duration::from_millis(100);
/// How long nobody looks then.
const RESPITE: Duration = Duration::from_secs(1);

/// How long it took to find data lately.
///
/// Where another process wants the core, perhaps the very one that is waited for, looking without
/// sleeping would cost milliseconds a message: each side looks in vain until the system takes the
/// core away from it. So who often looks for long leaves the core alone for a second.
#[derive(Debug, Default)]
pub(super) struct Looks {
    long_since: Option<Instant>,
    num_long: u32,
    respite_until: Option<Instant>,
}

impl Looks {
    /// Returns whether the core is left to others now.
    pub fn is_respite(&self, now: Instant) -> bool {
        self.respite_until.is_some_and(|until| now < until)
    }

    /// Takes when a look began and ended, found or not.
    pub fn note(&mut self, start: Instant, now: Instant) {
        if now - start <= LONG {
            return;
        }
        if self.long_since.is_none_or(|since| now - since > LONG_LOOKS) {
            self.long_since = Some(now);
            self.num_long = 0;
        }
        self.num_long += 1;
        if self.num_long > MAX_LONG {
            self.respite_until = Some(now + RESPITE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: Duration = Duration::from_millis(1);

    /// Looks for 3 ms so many times, with a pause before each; returns when that was over.
    fn look_long(looks: &mut Looks, count: u32, pause: Duration) -> Instant {
        let mut now = Instant::now();
        for _ in 0..count {
            now += pause;
            looks.note(now, now + 3 * MILLISECOND);
            now += 3 * MILLISECOND;
        }
        now
    }

    #[test]
    fn three_long_looks_at_once_are_followed_by_a_second_of_respite() {
        let mut looks = Looks::default();
        let now = look_long(&mut looks, 3, 10 * MILLISECOND);
        assert!(looks.is_respite(now + 999 * MILLISECOND));
        assert!(!looks.is_respite(now + 1000 * MILLISECOND));
    }

    #[test]
    fn a_long_look_now_and_then_is_nothing() {
        let mut looks = Looks::default();
        let now = look_long(&mut looks, 20, 60 * MILLISECOND);
        assert!(!looks.is_respite(now));
    }

    #[test]
    fn short_looks_are_nothing() {
        let mut looks = Looks::default();
        let now = Instant::now();
        for i in 0..100 {
            looks.note(now + i * LONG, now + (i + 1) * LONG);
        }
        assert!(!looks.is_respite(now + 100 * LONG));
    }
}
