//! The ledger of the clients: every act they sent, every receipt, and how far they saw each episode come. Whatever
//! contradicts it is a failure, told at once.

use std::collections::{BTreeMap, HashMap};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::{Duration, Instant};

use swarmbench_engine::{AgentId, Message};
use swarmbench_protocol::act::{ActRequest, Receipt};
use swarmbench_protocol::episode::{CreatedEpisode, EpisodeResult, State};
use swarmbench_protocol::observation::Observation;
use swarmbench_testkit::dice::Dice;

use crate::campaign::plan::CampaignGame;

/// An episode; and the seat of a token, if it is one of a seat.
pub(crate) type Holder = (Arc<Played>, Option<AgentId>);

/// All episodes of a campaign.
#[derive(Default)]
pub(crate) struct Ledger {
    games: Mutex<Vec<Arc<Played>>>,
    /// Holders by token.
    tokens: Mutex<HashMap<String, Holder>>,
}

impl Ledger {
    pub(crate) fn open(&self, game: CampaignGame, created: CreatedEpisode) -> Arc<Played> {
        let played = Arc::new(Played {
            game,
            created,
            acts: Mutex::default(),
            scores: Mutex::default(),
            states: Mutex::default(),
            stands_at: AtomicU32::new(0),
            result: OnceLock::new(),
            next_receipt: Mutex::default(),
        });
        let mut tokens = self.tokens.lock().expect("no failure yet");
        tokens.insert(played.created.swarm_token.clone(), (Arc::clone(&played), None));
        for agent in played.agents() {
            tokens.insert(played.token(agent).to_owned(), (Arc::clone(&played), Some(agent)));
        }
        self.games.lock().expect("no failure yet").push(Arc::clone(&played));
        played
    }

    /// Player that has a token.
    pub(crate) fn by_token(&self, token: &str) -> Option<Holder> {
        self.tokens.lock().expect("no failure yet").get(token).cloned()
    }

    /// The episodes that have not ended, as far as clients know.
    pub(crate) fn running(&self) -> Vec<Arc<Played>> {
        let mut all = self.all();
        all.retain(|played| !played.has_ended());
        all
    }

    pub(crate) fn all(&self) -> Vec<Arc<Played>> {
        self.games.lock().expect("no failure yet").clone()
    }

    /// One of the episodes that have ended.
    pub(crate) fn ended(&self, dice: &Dice) -> Option<Arc<Played>> {
        let all = self.games.lock().expect("no failure yet");
        let ended: Vec<_> = all.iter().filter(|played| played.result.get().is_some()).collect();
        (!ended.is_empty()).then(|| Arc::clone(*dice.pick(&ended)))
    }
}

/// An act that was sent.
#[derive(Clone, Debug)]
pub(crate) struct Sent {
    pub(crate) request: ActRequest,
    /// The first receipt.
    pub(crate) receipt: Option<Receipt>,
    /// True if the act came too late.
    pub(crate) refused: bool,
}

/// An episode as its clients know it.
pub(crate) struct Played {
    pub(crate) game: CampaignGame,
    pub(crate) created: CreatedEpisode,
    acts: Mutex<BTreeMap<(AgentId, u32), Sent>>,
    /// The score before each round that was seen, to the bit.
    scores: Mutex<BTreeMap<u32, f64>>,
    states: Mutex<BTreeMap<u32, State>>,
    /// At least at this round.
    stands_at: AtomicU32,
    result: OnceLock<EpisodeResult>,
    next_receipt: Mutex<NextReceipt>,
}

/// Time until the next receipt of an episode after a fault.
#[derive(Clone, Copy, Debug, Default)]
struct NextReceipt {
    after: Option<Instant>,
    taken: Option<Duration>,
}

/// A receipt that comes so soon after a server was ended was already on its way.
const ON_ITS_WAY: Duration = Duration::from_millis(20);

/// Knowledge of a client when it asked: the answer must not fall behind it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known {
    stands_at: u32,
    /// The newest round in which the seat's act was acknowledged.
    acted: Option<u32>,
}

impl Played {
    pub(crate) fn token(&self, agent: AgentId) -> &str {
        &self.created.seats[agent.index()].token
    }

    pub(crate) fn agents(&self) -> impl Iterator<Item = AgentId> + use<> {
        (0..self.created.config.num_agents).map(AgentId)
    }

    /// Name of the episode in messages of failures.
    pub(crate) fn name(&self) -> String {
        format!("{} (game {})", self.created.id, self.game.number)
    }

    pub(crate) fn stands_at(&self) -> u32 {
        self.stands_at.load(Ordering::SeqCst)
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.result.get().is_some()
    }

    /// Begins to wait for the next receipt.
    pub(crate) fn await_receipt(&self, after: Instant) {
        let next = NextReceipt { after: Some(after), taken: None };
        *self.next_receipt.lock().expect("no failure yet") = next;
    }

    /// Time until the next receipt, if it has come.
    pub(crate) fn next_receipt(&self) -> Option<Duration> {
        self.next_receipt.lock().expect("no failure yet").taken
    }

    /// Notes that a receipt has come now, for a request that was sent at this time.
    pub(crate) fn note_receipt(&self, sent: Instant) {
        let mut next = self.next_receipt.lock().expect("no failure yet");
        if let (Some(after), None) = (next.after, next.taken) {
            let taken = after.elapsed();
            if sent >= after || taken >= ON_ITS_WAY {
                next.taken = Some(taken);
            }
        }
    }

    /// Compares a receipt that nobody waited for any more with the one that counts.
    pub(crate) fn came_after_all(&self, receipt: &Receipt) {
        let agent = AgentId::parse(&receipt.agent).expect("an agent");
        let acts = self.acts.lock().expect("no failure yet");
        let sent = acts.get(&(agent, receipt.round));
        let first = sent.and_then(|sent| sent.receipt.clone());
        let first = first
            .unwrap_or_else(|| panic!("{}: refused, and acknowledged: {receipt:?}", self.name()));
        let late = Receipt { duplicate: false, ..receipt.clone() };
        assert_eq!(late, first, "{}: two receipts of one act", self.name());
    }

    /// The same of a refusal: an act that was acknowledged is not refused.
    pub(crate) fn refused_after_all(&self, agent: AgentId, round: u32, code: &str) {
        let acts = self.acts.lock().expect("no failure yet");
        let is_acknowledged = acts.get(&(agent, round)).is_some_and(|sent| sent.receipt.is_some());
        let name = self.name();
        assert!(!is_acknowledged, "{name}: {agent} in {round}: acknowledged, and refused: {code}");
    }

    pub(crate) fn known(&self, agent: AgentId) -> Known {
        let acts = self.acts.lock().expect("no failure yet");
        let mut own = acts.range((agent, 0)..=(agent, u32::MAX)).rev();
        let acted = own.find(|(_, sent)| sent.receipt.is_some()).map(|(&(_, round), _)| round);
        Known { stands_at: self.stands_at(), acted }
    }

    /// Notes that an act is about to be sent.
    pub(crate) fn will_send(&self, agent: AgentId, request: &ActRequest) {
        let sent = Sent { request: request.clone(), receipt: None, refused: false };
        let mut acts = self.acts.lock().expect("no failure yet");
        let before = acts.insert((agent, request.round), sent);
        assert!(before.is_none(), "{}: {agent} sends {} twice", self.name(), request.round);
    }

    /// Notes a receipt. The first may be a duplicate only where an answer was lost; every other must be the
    /// same as the first. Returns whether it was the first.
    pub(crate) fn acknowledged(&self, agent: AgentId, receipt: &Receipt, lost: bool) -> bool {
        let mut acts = self.acts.lock().expect("no failure yet");
        let name = self.name();
        let sent = acts.get_mut(&(agent, receipt.round));
        let sent = sent.unwrap_or_else(|| panic!("{name}: a receipt for nothing: {receipt:?}"));
        if let Some(first) = &sent.receipt {
            let expected = Receipt { duplicate: true, ..first.clone() };
            assert_eq!(receipt, &expected, "{name}: another receipt for the same act");
            return false;
        }
        assert!(!sent.refused, "{name}: refused before: {receipt:?}");
        assert!(lost || !receipt.duplicate, "{name}: this is the first time: {receipt:?}");
        assert_eq!((&receipt.episode, &receipt.agent), (&self.created.id, &agent.to_string()));
        if sent.request.response.is_none() {
            let message = sent.request.message.as_deref().and_then(Message::new);
            let message = message.map(|message| message.to_string());
            assert!(receipt.valid, "{name}: {receipt:?}");
            assert_eq!((&receipt.action, &receipt.message), (&sent.request.action, &message));
        }
        sent.receipt = Some(Receipt { duplicate: false, ..receipt.clone() });
        if receipt.waiting_for == 0 {
            self.stands_at.fetch_max(receipt.round + 1, Ordering::SeqCst);
        }
        true
    }

    /// Notes that an act came too late, which never happens to an acknowledged one.
    pub(crate) fn refused(&self, agent: AgentId, round: u32, code: &str) {
        let mut acts = self.acts.lock().expect("no failure yet");
        let sent = acts.get_mut(&(agent, round)).expect("it was sent");
        let name = self.name();
        assert!(sent.receipt.is_none(), "{name}: {agent} was acknowledged and is refused: {code}");
        let is_clocked = self.game.is_clocked();
        assert!(is_clocked, "{name}: {agent} is refused in {round}: {code}");
        assert!(["round_over", "episode_over"].contains(&code), "{name}: {agent}: {code}");
        sent.refused = true;
    }

    /// Compares an observation with what was known when it was asked for.
    pub(crate) fn seen(&self, agent: AgentId, known: Known, seen: &Observation) {
        let (name, sight) = (self.name(), &seen.sight);
        let round = sight.round;
        assert_eq!((&sight.episode, &sight.agent), (&self.created.id, &agent.to_string()));
        assert!(round >= known.stands_at, "{name} went back to {round}: {known:?}");
        let must_have_acted = sight.result.is_none() && known.acted == Some(round);
        assert!(seen.moment.acted || !must_have_acted, "{name}: the act of {agent} is gone");
        self.stands_at.fetch_max(round, Ordering::SeqCst);
        let mut scores = self.scores.lock().expect("no failure yet");
        let before = *scores.entry(round).or_insert(sight.score);
        assert_eq!(before.to_bits(), sight.score.to_bits(), "{name}: another score in {round}");
        let acts = self.acts.lock().expect("no failure yet");
        for past in &sight.history {
            let sent = acts.get(&(agent, past.round));
            let receipt = sent.and_then(|sent| sent.receipt.as_ref());
            if let Some(receipt) = receipt {
                let remembered = (&past.action, &past.message);
                assert_eq!(remembered, (&receipt.action, &receipt.message), "{name}: {agent}");
            }
        }
        if let Some(result) = &sight.result {
            self.ended(result);
        }
    }

    /// Notes how the episode ended: always the same way.
    pub(crate) fn ended(&self, result: &EpisodeResult) {
        assert_eq!(self.result.get_or_init(|| result.clone()), result, "{}", self.name());
    }

    /// Compares a state with the one that was seen of the same round before.
    pub(crate) fn saw_state(&self, state: &State) {
        let mut states = self.states.lock().expect("no failure yet");
        let before = states.entry(state.round).or_insert_with(|| state.clone());
        assert_eq!(before, state, "{}: another state", self.name());
    }

    /// One of the rounds of which the state was seen.
    pub(crate) fn seen_state(&self, dice: &Dice) -> Option<u32> {
        let states = self.states.lock().expect("no failure yet");
        let rounds: Vec<u32> = states.keys().copied().collect();
        (!rounds.is_empty()).then(|| *dice.pick(&rounds))
    }

    pub(crate) fn scores(&self) -> BTreeMap<u32, f64> {
        self.scores.lock().expect("no failure yet").clone()
    }

    pub(crate) fn acts(&self) -> BTreeMap<(AgentId, u32), Sent> {
        self.acts.lock().expect("no failure yet").clone()
    }

    /// The acknowledged acts of a seat, oldest first.
    pub(crate) fn acknowledged_acts(&self, agent: AgentId) -> Vec<ActRequest> {
        let acts = self.acts.lock().expect("no failure yet");
        let own = acts.range((agent, 0)..=(agent, u32::MAX));
        own.filter(|(_, sent)| sent.receipt.is_some())
            .map(|(_, sent)| sent.request.clone())
            .collect()
    }
}
