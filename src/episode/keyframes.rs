//! Keyframes: states that an episode keeps, so that the state of any round is quickly computed.

use std::sync::Arc;

use swarmbench_engine::World;

use super::heavy::step_micros;

/// Keyframes of an episode. When there are too many, or they are too large, every second one is dropped.
#[derive(Clone)]
pub(super) struct Keyframes {
    stride: u32,
    worlds: Vec<Arc<World>>,
    bytes: usize,
}

impl Keyframes {
    /// Microseconds of steps between two keyframes, as long as there is room for all of them.
    const STRIDE_MICROS: u64 = 200_000;
    /// Maximum rounds between two keyframes, where rounds are light: replaying some hundreds costs less than keeping states of
    /// every short game.
    const STRIDE_MAX: u64 = 512;
    /// Maximum bytes of all keyframes; a game takes as long to fill them as the steps between them.
    const BYTES_MAX: usize = 64 * 1024 * 1024;
    /// Maximum number of keyframes, however small they are.
    const COUNT_MAX: usize = 1024;

    /// Starts with the layout, which is always kept.
    pub(super) fn new(layout: Arc<World>) -> Self {
        let stride = Self::STRIDE_MICROS / step_micros(layout.config());
        let stride = u32::try_from(stride.clamp(1, Self::STRIDE_MAX)).expect("at most STRIDE_MAX");
        let bytes = layout.approximate_bytes();
        Self { stride, worlds: vec![layout], bytes }
    }

    pub(super) fn layout(&self) -> &World {
        &self.worlds[0]
    }

    pub(super) fn offer(&mut self, world: &Arc<World>) {
        if !world.round().is_multiple_of(self.stride) || world.round() == 0 {
            return;
        }
        self.worlds.push(Arc::clone(world));
        self.bytes += world.approximate_bytes();
        while self.worlds.len() > 1
            && (self.worlds.len() > Self::COUNT_MAX || self.bytes > Self::BYTES_MAX)
        {
            self.stride *= 2;
            self.worlds.retain(|world| world.round().is_multiple_of(self.stride));
            self.bytes = self.worlds.iter().map(|world| world.approximate_bytes()).sum();
        }
    }

    /// Estimated bytes of all keyframes.
    pub(super) const fn bytes(&self) -> usize {
        self.bytes
    }

    pub(super) fn before(&self, round: u32) -> Arc<World> {
        let place = self.worlds.partition_point(|world| world.round() <= round);
        Arc::clone(&self.worlds[place.saturating_sub(1)])
    }
}

#[cfg(test)]
mod tests {
    use swarmbench_engine::{Config, Settings, TaskName};

    use super::*;

    #[test]
    fn keyframes_are_closer_where_rounds_are_expensive_and_have_a_bound() {
        for (agents, view) in [(10, 5), (128, 41), (256, 63), (1024, 31)] {
            let mut settings = Settings::standard(TaskName::Pursuit, 1);
            (settings.num_agents, settings.width, settings.height) = (agents, 64, 64);
            (settings.view_size, settings.memory) = (view, 0);
            let config = Arc::new(Config::check(&settings).expect("good settings"));
            let keyframes = Keyframes::new(Arc::new(World::new(Arc::clone(&config))));
            let between = u64::from(keyframes.stride) * step_micros(&config);
            assert!(between <= Keyframes::STRIDE_MICROS || keyframes.stride == 1, "{between} µs");
        }
        let settings = Settings { max_round: 10_000, ..Settings::standard(TaskName::Pursuit, 1) };
        let config = Arc::new(Config::check(&settings).expect("good settings"));
        let mut world = World::new(config);
        let mut keyframes = Keyframes::new(Arc::new(world.clone()));
        keyframes.stride = 1;
        let stays = vec![swarmbench_engine::Act::default(); 12];
        for _ in 0..2 * Keyframes::COUNT_MAX {
            world.step(&stays);
            keyframes.offer(&Arc::new(world.clone()));
            assert!(
                keyframes.worlds.len() <= Keyframes::COUNT_MAX
                    && keyframes.bytes() <= Keyframes::BYTES_MAX
            );
        }
        assert!(keyframes.stride > 1, "every second one was dropped");
    }
}
