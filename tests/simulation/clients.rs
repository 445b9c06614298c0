//! Requests of clients, and their handling: the work of the server's handlers without HTTP.

use std::collections::VecDeque;
use std::sync::{Arc, LazyLock, Mutex};
use std::time::Duration;

use futures::future::select;
use jiff::Timestamp;
use swarmbench::episode::Snapshot;
use swarmbench::episode::actor::{Claim, ClaimError, Claimed, Handle, Outcomes, StartError};
use swarmbench::episode::lockstep::Submission;
use swarmbench::episode::quota::Purpose;
use swarmbench::episode::recovery::RecoveryError;
use swarmbench::episode::registry::{CreateError, Creation, FindError, Registry};
use swarmbench::episode::replay::state_at;
use swarmbench::episode::seating::Wanted;
use swarmbench::episode::spec::Spec;
use swarmbench::fair::Party;
use swarmbench::ids::{EpisodeId, TokenHash};
use swarmbench::store::StoreError;
use swarmbench::store::entries::Holder;
use swarmbench_clock::{Clock, after};
use swarmbench_engine::{
    Act, Action, AgentId, Config, Control, Message, Settings, TaskName, answer,
};
use swarmbench_journal::record::{Decision, Usage};
use swarmbench_players::default_for;
use swarmbench_players::game::play;
use swarmbench_protocol::failure::Failure;
use swarmbench_testkit::worlds::Dice;

use crate::game;
use crate::simulation::executor::pause;
use crate::simulation::run::ROUNDS_MAX;
use crate::simulation::time::SimClock;
use swarmbench::cluster::Incarnation;

/// Duration of a client's wait for a round.
const PATIENCE: Duration = Duration::from_secs(10);

/// The number of a request, in the order of sending.
pub(crate) type RequestId = u32;

/// Acts with their seats, as in `/swarm/act`.
pub(crate) type Acts = Vec<(AgentId, Submission)>;

/// A request of a client.
#[derive(Clone, Debug)]
pub(crate) enum Request {
    /// Creates an episode.
    Create(Box<Spec>, Option<swarmbench::keys::OwnerKey>),
    /// Observes the published state.
    Look,
    /// Observes as soon as the round is past this one.
    Wait(u32),
    /// Observes, thinks, and acts for those of these seats for which the round waits.
    Turn(Vec<AgentId>, u64),
    /// Sends acts that were decided earlier.
    Send(Acts),
    /// Claims open seats.
    Claim(Wanted),
    /// Starts the episode manually.
    Start,
    /// Aborts the episode.
    Abort,
    /// Reads the state after a number of rounds.
    State(u32),
}

/// An event of a request.
pub(crate) enum News {
    /// The acts of the request are in the mailbox of the episode.
    Arrived(Acts),
    /// The request saw this snapshot.
    Seen(Arc<Snapshot>),
    /// The request was answered.
    Answered(SimAnswer),
}

/// The answer to a client.
pub(crate) enum SimAnswer {
    Created(Result<(), CreateError>),
    /// The episode does not exist.
    Nothing,
    /// The episode cannot be recovered.
    NotTakenUp(RecoveryError),
    /// The snapshot, which was reported before.
    Looked,
    /// The outcomes of acts, and the snapshot published by then.
    Acted(Acts, Outcomes, Arc<Snapshot>),
    Claimed(Wanted, Result<Claimed, ClaimError>),
    Started(Result<(), StartError>),
    Aborted(Result<(), StoreError>),
    /// The digest of the state after a number of rounds.
    State(u32, Result<[u8; 32], RecoveryError>),
    /// No server answers, or the one that did does not know whether the request was executed.
    Away,
}

fn not_taken_up(error: FindError) -> SimAnswer {
    match error {
        FindError::Recovery(error) => SimAnswer::NotTakenUp(error),
        FindError::NoMemory(full) => unreachable!("memory has no bound here: {full}"),
    }
}

/// An event of a request, and the server that reported it.
pub(crate) struct Told {
    pub(crate) number: RequestId,
    pub(crate) id: EpisodeId,
    pub(crate) server: Incarnation,
    /// True if that server played the episode at this moment, or nobody did as it was over.
    pub(crate) plays: bool,
    pub(crate) news: News,
}

/// The queue of requests' events, which the run reads after each step.
pub(crate) type Desk = Arc<Mutex<VecDeque<Told>>>;

/// Handles a request at a server.
pub(crate) async fn serve(
    registry: &Registry,
    clock: &SimClock,
    say: impl Fn(News),
    id: EpisodeId,
    request: Request,
) {
    if let Request::Create(spec, owner) = request {
        let creation = Creation {
            id,
            party: Party::of_key(owner),
            purpose: Purpose::Usual,
            run: None,
            spec: *spec,
            holder_metas: Vec::new(),
            tokens: Vec::new(),
            idempotency: None,
        };
        let created = registry.create(creation).await;
        let created = created.map(|handle| say(News::Seen(handle.snapshot())));
        return say(News::Answered(SimAnswer::Created(created)));
    }
    let handle = match registry.find(&id).await {
        Ok(Some(handle)) => handle,
        Ok(None) => return say(News::Answered(SimAnswer::Nothing)),
        Err(error) => return say(News::Answered(not_taken_up(error))),
    };
    let answer = match request {
        Request::Create(..) | Request::Look => {
            say(News::Seen(handle.snapshot()));
            SimAnswer::Looked
        }
        Request::Wait(round) => {
            let mut published = handle.follow();
            let past = |seen: &Arc<Snapshot>| seen.status.is_over() || seen.world.round() > round;
            // A wait ends after a while, or if the actor is gone and nobody publishes any more; the answer is then
            // the current snapshot.
            let published = std::pin::pin!(async { drop(published.wait_for(past).await) });
            drop(select(published, clock.sleep_until(after(clock.now(), PATIENCE))).await);
            say(News::Seen(handle.snapshot()));
            SimAnswer::Looked
        }
        Request::Turn(seats, seed) => {
            let seen = handle.snapshot();
            say(News::Seen(Arc::clone(&seen)));
            drop(handle);
            let acts = think(seats, seed, seen).await;
            if acts.is_empty() {
                SimAnswer::Looked
            } else {
                // Observing and acting are two requests.
                match registry.find(&id).await {
                    Ok(Some(handle)) => send(&handle, acts, &say).await,
                    Ok(None) => SimAnswer::Nothing,
                    Err(error) => not_taken_up(error),
                }
            }
        }
        Request::Send(acts) => send(&handle, acts, &say).await,
        Request::Claim(wanted) => {
            let holder = Holder {
                number: 0,
                owner: None,
                key: None,
                model: "a holder".to_owned(),
                agent_meta: swarmbench_protocol::carried::Carried::default(),
                player: None,
                at: clock.now(),
            };
            let (seats, swarm) = (Vec::new(), TokenHash([0; 32]));
            let claim = Claim { holder, wanted, seats, swarm, idempotency: None };
            SimAnswer::Claimed(wanted, handle.claim(claim).await)
        }
        Request::Start => SimAnswer::Started(handle.start().await),
        Request::Abort => SimAnswer::Aborted(handle.abort().await),
        Request::State(round) => {
            let state = state_at(registry.host(), &handle, round, None).await;
            SimAnswer::State(round, state.map(|world| world.digest().0))
        }
    };
    say(News::Answered(answer));
}

/// Decides acts of a client for those of its seats for which the round waits.
pub(crate) async fn think(seats: Vec<AgentId>, seed: u64, seen: Arc<Snapshot>) -> Acts {
    let mut dice = Dice(seed);
    let config = Arc::clone(seen.world.config());
    pause(dice.below(3)).await;
    (seats.into_iter().filter(|&seat| seen.waits_for(seat)))
        .map(|seat| (seat, turn(&mut dice, &config, seat, seen.world.round())))
        .collect()
}

async fn send(handle: &Handle, acts: Acts, say: impl Fn(News)) -> SimAnswer {
    say(News::Arrived(acts.clone()));
    let outcomes = handle.submit(acts.clone()).await;
    SimAnswer::Acted(acts, outcomes, handle.snapshot())
}

/// A rehearsed game that ends before its last round, with agents that escape, which random play would not reach. With
/// these settings the built-in player needs 14 rounds.
static REHEARSED: LazyLock<(Settings, Vec<Vec<Act>>)> = LazyLock::new(|| {
    let standard = Settings::standard(TaskName::Transport, 393);
    let settings =
        Settings { num_agents: 6, width: 8, height: 8, max_round: ROUNDS_MAX, ..standard };
    let (_, acts) =
        play(default_for(TaskName::Transport), &settings, 1).expect("playable settings");
    (settings, acts)
});

/// The act of a sensible client: the rehearsed one, or any.
fn turn(dice: &mut Dice, config: &Config, agent: AgentId, round: u32) -> Submission {
    let (settings, acts) = &*REHEARSED;
    match acts.get(round as usize) {
        Some(acts) if config.settings() == *settings => {
            submission(round, acts[agent.index()].clone())
        }
        _ => act(dice, config, agent, round),
    }
}

/// A random act for a seat.
pub(crate) fn act(dice: &mut Dice, config: &Config, agent: AgentId, round: u32) -> Submission {
    let actions = Action::of_task(config.task());
    let action = actions[dice.below(actions.len())];
    let response = match dice.below(10) {
        0 => Some("I do not know what to do.".to_owned()),
        1 | 2 => Some(format!("Well.\nACTION: {}\nMSG: on my way", action.name())),
        _ => None,
    };
    let message = (dice.below(3) == 0).then(|| Message::new("the block is to the left")).flatten();
    let mut sent = if let Some(response) = response {
        let read = answer::parse(&response, config, agent);
        let (valid, fault) = (read.is_valid(), read.fault);
        let mut sent = submission(round, read.act);
        sent.decision.valid = valid;
        sent.decision.failure = fault.map(|fault| Failure::of(None, fault));
        sent.decision.response = Some(response);
        sent
    } else {
        let commands = config.control() == Control::Centralized && agent == AgentId::COMMANDER;
        let to = (commands && message.is_some()).then_some(AgentId(config.num_agents() - 1));
        let to = to.filter(|&to| to != agent);
        submission(round, Act { action: Some(action), message, to })
    };
    sent.decision.reasoning = (dice.below(8) == 0).then(|| "so it is said ".repeat(200));
    sent
}

fn submission(round: u32, act: Act) -> Submission {
    Submission { round, decision: Decision::of_player(act) }
}

/// The same act again, with other circumstances.
pub(crate) fn again(dice: &mut Dice, sent: &Submission) -> Submission {
    let mut again = sent.clone();
    match dice.below(3) {
        0 => {
            again.decision.usage =
                Some(Box::new(Usage { latency_ms: Some(7), ..Usage::default() }));
        }
        1 => again.decision.reasoning = Some("again".to_owned()),
        _ => {}
    }
    again
}

/// The clocks of a run's episodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Times {
    /// True if rounds have deadlines: never, sometimes or always.
    pub(crate) clocked: usize,
    /// True if episodes without deadlines are abandoned after 30 seconds, not hours.
    pub(crate) short_idle: bool,
}

/// A random small episode.
pub(crate) fn spec(dice: &mut Dice, times: Times, now: Timestamp) -> Spec {
    let rehearsed = dice.below(10) == 0;
    let settings = |dice: &mut Dice| if rehearsed { REHEARSED.0.clone() } else { settings(dice) };
    let config = std::iter::from_fn(|| Some(settings(dice)))
        .find_map(|settings| Config::check(&settings).ok())
        .expect("most settings can be played");
    let clocked = dice.below(2) < times.clocked;
    let bank = [0, 0, 2_500, 60_000][dice.below(4)];
    let seats = config.num_agents();
    let mixed = dice.below(4) == 0;
    let open = if mixed { 1 + u16::try_from(dice.below(seats.into())).expect("few") } else { 0 };
    let fill_after = (mixed && dice.below(2) == 0)
        .then(|| Duration::from_millis([0, 700, 6_000][dice.below(3)]));
    // `random` draws its acts, so they reveal whether it remembers its draws.
    let player = (open < seats && dice.below(5) == 0).then(|| "random".to_owned());
    let closes_ms = [20, 3_000, 60_000, 1_500_000][dice.below(4)];
    let closes_at = (dice.below(4) == 0).then(|| after(now, Duration::from_millis(closes_ms)));
    let idle_s = [if times.short_idle { 30 } else { 7_200 }, 1_200, 7_200][dice.below(3)];
    Spec {
        round_deadline: clocked
            .then(|| Duration::from_millis([50, 1_000, 5_000, 5_000][dice.below(4)])),
        bank: Duration::from_millis(bank),
        manual_start: dice.below(4) == 0,
        idle_timeout: Duration::from_secs(idle_s),
        model: "simulated".to_owned(),
        closes_at,
        open_seats: (seats - open..seats).map(AgentId).collect(),
        fill_with: fill_after.map(|_| "random".to_owned()),
        fill_after,
        player,
        ..game::spec(config)
    }
}

fn settings(dice: &mut Dice) -> Settings {
    let mut below = |n: usize| i64::try_from(dice.below(n)).expect("a small number");
    let size = 8 + below(3);
    let reference = below(4) == 0;
    let task = TaskName::ALL[usize::try_from(below(5)).expect("a place")];
    Settings {
        rules: if reference { "reference" } else { "paper" }.to_owned(),
        control: if below(4) == 0 { "centralized" } else { "decentralized" }.to_owned(),
        seed: below(1 << 20),
        num_agents: [1, 2, 2, 3, 3, 4, 5][usize::try_from(below(7)).expect("a place")],
        width: size,
        height: if reference { size } else { 8 + below(3) },
        view_size: 3 + 2 * below(2),
        memory: below(3),
        max_round: 1 + below(7),
        noise: if below(4) == 0 { 0.3 } else { 0.0 },
        max_delay: below(2),
        ..Settings::standard(task, 0)
    }
}
