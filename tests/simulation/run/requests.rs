//! Requests of clients, drawn from the seed.

use std::sync::Arc;

use futures::FutureExt as _;
use swarmbench::episode::seating::Wanted;
use swarmbench::ids::EpisodeId;
use swarmbench::keys::OwnerKey;
use swarmbench_clock::Clock as _;
use swarmbench_engine::AgentId;

use super::SimulationRun;
use super::trace::asked;
use crate::simulation::checker::Episode;
use crate::simulation::clients::{Request, Told, act, again, serve, spec};
use crate::simulation::cluster::{Order, client};
use crate::simulation::executor::CLIENTS;

impl SimulationRun {
    pub(super) fn ask(&mut self, id: EpisodeId, request: Request) {
        self.asked += 1;
        let number = self.asked;
        self.note(format!("request {number} for {id}: {}", asked(&request)));
        self.checker.sent(number, &id, &request);
        let task = if self.is_shared() {
            let (net, seed) = (Arc::clone(&self.net), self.dice.below(1 << 30) as u64);
            let task = client(net, Order { number, id, request }, seed);
            self.executor.spawn(CLIENTS, task.boxed())
        } else {
            let place = self.dice.below(self.servers.len());
            let server = &self.servers[place];
            let (registry, incarnation) = (server.registry.clone(), server.incarnation);
            let (clock, desk) = (Arc::clone(&self.clock), Arc::clone(&self.desk));
            let task = async move {
                let say = |news| {
                    let (id, server) = (id.clone(), incarnation);
                    let told = Told { number, id, server, plays: true, news };
                    desk.lock().expect("one thread").push_back(told);
                };
                serve(&registry, &clock, say, id.clone(), request).await;
            };
            self.executor.spawn(incarnation, task.boxed())
        };
        self.pending.insert(number, task);
    }

    /// Draws a request.
    pub(super) fn request(&mut self) -> Option<(EpisodeId, Request)> {
        let dice = &mut self.dice;
        let known: Vec<&Episode> = self.checker.episodes.values().collect();
        if known.is_empty() || (self.created < self.options.episodes && dice.below(4) == 0) {
            self.created += 1;
            let id = EpisodeId::from_text(format!("ep_{}", self.created));
            let owner = (dice.below(2) == 0).then_some(OwnerKey(1));
            let spec = spec(dice, self.options.times, self.clock.now());
            return Some((id, Request::Create(Box::new(spec), owner)));
        }
        // Most requests are for unfinished episodes.
        let live: Vec<&Episode> = known.iter().copied().filter(|e| e.end.is_none()).collect();
        let of = if live.is_empty() || dice.below(8) == 0 { &known } else { &live };
        let episode = of[dice.below(of.len())];
        let (id, round) = (episode.id.clone(), episode.world.round());
        let mut seats: Vec<AgentId> = episode.world.agents().collect();
        let one = AgentId(u16::try_from(dice.below(seats.len())).expect("few"));
        if episode.spec.is_mixed() && episode.waiting && dice.below(2) == 0 {
            let some = u16::try_from(1 + dice.below(2)).expect("few");
            let wanted = if dice.below(2) == 0 { Wanted::Seat(one) } else { Wanted::Any(some) };
            return Some((id, Request::Claim(wanted)));
        }
        // Nobody has tokens of open seats, or of seats that the server plays.
        seats.retain(|agent| episode.is_clients(*agent));
        if seats.is_empty() {
            seats.push(one);
            return Some((id, Request::Look));
        }
        let one = seats[dice.below(seats.len())];
        let strays = self.options.strays * 10;
        let weights = [30, 10, strays, strays, 4, 3, 2, if self.options.aborts { 2 } else { 0 }];
        let mut drawn = dice.below(weights.iter().sum());
        let kind = weights.iter().position(|&weight| {
            let is_it = drawn < weight;
            drawn = drawn.saturating_sub(weight);
            is_it
        });
        let request = match kind.expect("one of them") {
            0 => Request::Turn(vec![one], dice.below(1 << 30) as u64),
            1 => Request::Turn(seats, dice.below(1 << 30) as u64),
            2 if !self.acts.is_empty() => {
                // The same acts again, or other acts for the same seats and round.
                let (id, acts) = &self.acts[dice.below(self.acts.len())];
                let config = self.checker.episode(id).map(|e| Arc::clone(&e.spec.config))?;
                let changed = dice.below(3) == 0;
                let acts = (acts.iter())
                    .map(|(agent, sent)| {
                        let changes = changed && dice.below(2) == 0;
                        let next = if changes {
                            act(dice, &config, *agent, sent.round)
                        } else {
                            again(dice, sent)
                        };
                        (*agent, next)
                    })
                    .collect();
                return Some((id.clone(), Request::Send(acts)));
            }
            2 | 3 => {
                // Any seats, too early or too late.
                let count = 1 + dice.below(3);
                let acts = (0..count).map(|_| {
                    let agent = seats[dice.below(seats.len())];
                    let round =
                        (round + 2).saturating_sub(u32::try_from(dice.below(5)).expect("few"));
                    (agent, act(dice, &episode.spec.config, agent, round))
                });
                Request::Send(acts.collect())
            }
            4 => Request::Wait(round),
            5 if episode.waiting => Request::Start,
            5 if episode.spec.is_mixed() => Request::Claim(Wanted::Any(1)),
            5 => Request::Look,
            6 => Request::State(u32::try_from(dice.below(round as usize + 1)).expect("a round")),
            _ => Request::Abort,
        };
        let request = if episode.waiting && dice.below(4) == 0 { Request::Start } else { request };
        Some((id, request))
    }
}
