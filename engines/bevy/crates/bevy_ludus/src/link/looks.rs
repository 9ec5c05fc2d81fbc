//! When to look for data without sleeping, and when to leave the core to others.

use std::time::{Duration, Instant};

/// Between one look and the next it takes so long only if the core was taken away meanwhile.
const AWAY: Duration = Duration::from_millis(1);
/// Lost looks within [`LOST_WITHIN`] that mean nothing: updates, or the system's own work.
const MAX_LOST: u32 = 5;
const LOST_WITHIN: Duration = Duration::from_millis(100);
/// How long nobody looks then.
const RESPITE: Duration = Duration::from_secs(1);

/// How looking for data went lately.
///
/// Where another process wants the core, perhaps the very one that is waited for, looking without
/// sleeping would cost milliseconds a message: each side looks in vain until the system takes the
/// core away from it. So who often finds nothing, or loses the core meanwhile, leaves it alone for a
/// second.
#[derive(Debug, Default)]
pub(super) struct Looks {
    lost_since: Option<Instant>,
    num_lost: u32,
    respite_until: Option<Instant>,
}

impl Looks {
    /// Returns whether the core is left to others now.
    pub fn is_respite(&self, now: Instant) -> bool {
        self.respite_until.is_some_and(|until| now < until)
    }

    /// Returns whether the core was taken away between two looks.
    pub fn was_away(before: Instant, now: Instant) -> bool {
        now - before > AWAY
    }

    /// Takes that looking found nothing, or lost the core meanwhile.
    pub fn note_lost(&mut self, now: Instant) {
        if self
            .lost_since
            .is_none_or(|since| now - since > LOST_WITHIN)
        {
            self.lost_since = Some(now);
            self.num_lost = 0;
        }
        self.num_lost += 1;
        if self.num_lost > MAX_LOST {
            self.respite_until = Some(now + RESPITE);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MILLISECOND: Duration = Duration::from_millis(1);

    /// Loses so many looks, with a pause before each; returns when the last was over.
    fn lose(looks: &mut Looks, count: u32, pause: Duration) -> Instant {
        let mut now = Instant::now();
        for _ in 0..count {
            now += pause;
            looks.note_lost(now);
        }
        now
    }

    #[test]
    fn six_lost_looks_at_once_are_followed_by_a_second_of_respite() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, 6, 15 * MILLISECOND);
        assert!(looks.is_respite(now + 999 * MILLISECOND));
        assert!(!looks.is_respite(now + 1000 * MILLISECOND));
    }

    #[test]
    fn five_at_once_are_nothing() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, 5, 15 * MILLISECOND);
        assert!(!looks.is_respite(now));
    }

    #[test]
    fn one_now_and_then_is_nothing() {
        let mut looks = Looks::default();
        let now = lose(&mut looks, 20, 30 * MILLISECOND);
        assert!(!looks.is_respite(now));
    }

    #[test]
    fn the_core_was_away_where_a_millisecond_is_missing() {
        let now = Instant::now();
        assert!(!Looks::was_away(now, now + MILLISECOND));
        assert!(Looks::was_away(now, now + 2 * MILLISECOND));
    }
}
