//! The choice of the server that answers a request, forwarding, and clients, which retry.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures::future::{Either, select};
use swarmbench::episode::actor::{ActError, ClaimError, StartError};
use swarmbench::episode::recovery::RecoveryError;
use swarmbench::ids::{EpisodeId, Place};
use swarmbench::store::StoreError;
use swarmbench_clock::{Clock as _, after};
use swarmbench_testkit::worlds::Dice;
use tokio::sync::oneshot;

use super::{Net, Node, Reply, lease};
use crate::simulation::clients::{Answer, News, Request, RequestId, Told, serve, think};
use crate::simulation::database::Incarnation;

/// Duration of a request's wait for another server to take over the place.
const MOVE_PATIENCE: Duration = Duration::from_millis(1500);

/// Interval between two looks meanwhile.
const MOVE_PAUSE: Duration = Duration::from_millis(25);

/// A client's timeout of an answer: longer than any wait for a round.
const ANSWER_PATIENCE: Duration = Duration::from_secs(12);

/// A client's attempts.
const TRIES: usize = 8;

/// A request that can be forwarded.
#[derive(Clone)]
pub(crate) struct Order {
    pub(crate) number: RequestId,
    pub(crate) id: EpisodeId,
    pub(crate) request: Request,
}

impl Order {
    /// Whether the request may be sent twice: it only reads, or it is an act, which is idempotent.
    const fn is_repeatable(&self) -> bool {
        !matches!(
            self.request,
            Request::Create(..) | Request::Claim(_) | Request::Start | Request::Abort
        )
    }
}

/// The server that answers a request.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Location {
    Here,
    At(Incarnation),
}

/// A failure to forward a request.
enum Failed {
    NotSent,
    Unknown,
}

/// Answers a request at a server, unless its sender goes away.
pub(super) async fn answer(
    net: Arc<Net>,
    node: Arc<Node>,
    order: Order,
    is_hop: bool,
    mut done: oneshot::Sender<Reply>,
) {
    let reply = {
        let answering = std::pin::pin!(front(&net, &node, &order, is_hop));
        match select(answering, std::pin::pin!(done.closed())).await {
            Either::Left((reply, _)) => reply,
            Either::Right(_) => return,
        }
    };
    drop(done.send(reply));
}

async fn front(net: &Arc<Net>, node: &Arc<Node>, order: &Order, is_hop: bool) -> Reply {
    if !node.answers() {
        return Reply::NotDone;
    }
    let place = match &order.request {
        Request::Create(..) => None,
        _ => node.place_of(&order.id).await,
    };
    match place {
        Some(place) if is_hop => match node.takes(place).await {
            Ok(true) => here(net, node, order, true).await,
            Ok(false) => Reply::Elsewhere,
            Err(_) => Reply::NotDone,
        },
        Some(place) => match node.locate(place).await {
            Ok(Location::Here) => here(net, node, order, false).await,
            Ok(Location::At(at)) => forward(net, node, order, place, at).await,
            Err(_) => Reply::NotDone,
        },
        None => here(net, node, order, is_hop).await,
    }
}

/// Answers at this server.
async fn here(net: &Net, node: &Node, order: &Order, is_hop: bool) -> Reply {
    let buffer = Mutex::new(Vec::new());
    let say = |news| {
        let told = Told {
            number: order.number,
            id: order.id.clone(),
            server: node.incarnation,
            plays: node.plays(&order.id),
            news,
        };
        if matches!(told.news, News::Arrived(_)) {
            net.desk.lock().expect("one thread").push_back(told);
        } else {
            buffer.lock().expect("one thread").push(told);
        }
    };
    serve(&node.registry, &net.clock, say, order.id.clone(), order.request.clone()).await;
    if !node.answers() {
        return Reply::Unknown;
    }
    let told = buffer.into_inner().expect("one thread");
    match failure(&told) {
        Some(StoreError::Elsewhere) if is_hop => Reply::Elsewhere,
        Some(StoreError::Elsewhere) => Reply::NotDone,
        _ => Reply::Done(told),
    }
}

/// Forwards the request; retries once at the new owner.
async fn forward(
    net: &Arc<Net>,
    node: &Arc<Node>,
    order: &Order,
    place: Place,
    at: Incarnation,
) -> Reply {
    let answered = send(net, at, order).await;
    match answered {
        Ok(Reply::Elsewhere) | Err(Failed::NotSent) => {}
        Ok(reply) => return reply,
        Err(Failed::Unknown) if !order.is_repeatable() => {
            node.forget(place);
            return Reply::Unknown;
        }
        Err(Failed::Unknown) => {}
    }
    match located_again(net, node, place, at, answered.is_err()).await {
        Some(Location::Here) => here(net, node, order, false).await,
        Some(Location::At(next)) => match send(net, next, order).await {
            Ok(Reply::Elsewhere) | Err(Failed::NotSent) => {
                node.forget(place);
                Reply::NotDone
            }
            Ok(reply) => reply,
            Err(Failed::Unknown) => {
                node.forget(place);
                Reply::Unknown
            }
        },
        None => Reply::NotDone,
    }
}

async fn send(net: &Arc<Net>, to: Incarnation, order: &Order) -> Result<Reply, Failed> {
    let answer = net.send(to, order, true).ok_or(Failed::NotSent)?;
    answer.await.map_err(|_| Failed::Unknown)
}

/// Locates a place again after a server has not answered: waits for another server to take it over.
async fn located_again(
    net: &Net,
    node: &Node,
    place: Place,
    before: Incarnation,
    is_away: bool,
) -> Option<Location> {
    let until = after(net.clock.now(), MOVE_PATIENCE);
    loop {
        node.forget(place);
        if is_away && !net.is_there(before) {
            lease::exclude(node, before, true).await;
        }
        match node.locate(place).await {
            Ok(Location::At(at)) if at == before && is_away => {}
            Ok(location) => return Some(location),
            Err(StoreError::Elsewhere) => {}
            Err(_) => return None,
        }
        if net.clock.now() >= until {
            return None;
        }
        net.clock.sleep_until(after(net.clock.now(), MOVE_PAUSE)).await;
    }
}

impl Node {
    /// Whether this server plays an episode, or nobody does as it has ended or does not exist.
    fn plays(&self, id: &EpisodeId) -> bool {
        self.journal.with_tables(|tables| {
            tables.key_of(id).is_none_or(|key| {
                let place = Place::Game(key);
                tables.owner(place) == Some(self.incarnation) || !tables.is_unfinished(place)
            })
        })
    }

    async fn place_of(&self, id: &EpisodeId) -> Option<Place> {
        if let Some(place) = self.places.lock().expect("one thread").get(id) {
            return Some(*place);
        }
        let key = self.journal.at_database(|tables| tables.key_of(id)).await?;
        self.places.lock().expect("one thread").insert(id.clone(), Place::Game(key));
        Some(Place::Game(key))
    }

    async fn is_unfinished(&self, place: Place) -> bool {
        self.journal.at_database(|tables| tables.is_unfinished(place)).await
    }

    /// Whether this server plays at a place, or can take it now.
    async fn takes(&self, place: Place) -> Result<bool, StoreError> {
        if self.journal.plays_at(place) || !self.is_unfinished(place).await {
            return Ok(true);
        }
        self.journal.take_place(place).await?;
        Ok(self.journal.plays_at(place))
    }

    async fn locate(&self, place: Place) -> Result<Location, StoreError> {
        let owner = self.owner(place).await?;
        let Some(owner) = owner.filter(|owner| *owner != self.incarnation) else {
            return Ok(Location::Here);
        };
        if self.sees(owner) {
            return Ok(Location::At(owner));
        }
        self.forget(place);
        Err(StoreError::Elsewhere)
    }

    fn sees(&self, incarnation: Incarnation) -> bool {
        self.members().iter().any(|member| member.incarnation == incarnation)
    }

    /// The owner of a place, or else the server that should take it; `None` if everything there has ended.
    async fn owner(&self, place: Place) -> Result<Option<Incarnation>, StoreError> {
        let me = self.incarnation;
        if self.journal.plays_at(place) {
            return Ok(Some(me));
        }
        let known = self.owners.lock().expect("one thread").get(&place).copied();
        if let Some(owner) = known.filter(|owner| owner.is_none_or(|owner| self.sees(owner))) {
            return Ok(owner);
        }
        let owner = match self.journal.at_database(|tables| tables.owner(place)).await {
            Some(owner) => Some(owner),
            None if !self.is_unfinished(place).await => None,
            None => {
                let preferred = self.preferred(place);
                if preferred != me {
                    // The preferred server takes the place when the request arrives.
                    return Ok(Some(preferred));
                }
                Some(self.journal.take_place(place).await?)
            }
        };
        if owner == Some(me) {
            // The place is being given up, or a commit with a lost answer has taken it.
            self.journal.take_place(place).await?;
            let plays = self.journal.plays_at(place);
            return if plays { Ok(owner) } else { Err(StoreError::Elsewhere) };
        }
        self.owners.lock().expect("one thread").insert(place, owner);
        Ok(owner)
    }

    fn forget(&self, place: Place) {
        self.owners.lock().expect("one thread").remove(&place);
    }
}

/// Sends a client's request to any server, and again to any if it was not answered and is repeatable.
pub(crate) async fn client(net: Arc<Net>, mut order: Order, seed: u64) {
    let mut dice = Dice(seed);
    if let Request::Turn(seats, seed) = order.request.clone() {
        // Observing and acting are two requests.
        order.request = Request::Look;
        let Some(mut told) = ask(&net, &mut dice, &order).await else { return away(&net, order) };
        let seen = told.iter().find_map(|told| match &told.news {
            News::Seen(snapshot) => Some(Arc::clone(snapshot)),
            News::Arrived(_) | News::Answered(_) => None,
        });
        if let Some(seen) = seen {
            let answered = told.pop();
            net.desk.lock().expect("one thread").extend(told);
            let acts = think(seats, seed, seen).await;
            if acts.is_empty() {
                net.desk.lock().expect("one thread").extend(answered);
                return;
            }
            order.request = Request::Send(acts);
        } else {
            net.desk.lock().expect("one thread").extend(told);
            return;
        }
    }
    match ask(&net, &mut dice, &order).await {
        Some(told) => net.desk.lock().expect("one thread").extend(told),
        None => away(&net, order),
    }
}

fn away(net: &Net, Order { number, id, .. }: Order) {
    let news = News::Answered(Answer::Away);
    let told = Told { number, id, server: crate::simulation::executor::CLIENTS, plays: true, news };
    net.desk.lock().expect("one thread").push_back(told);
}

async fn ask(net: &Arc<Net>, dice: &mut Dice, order: &Order) -> Option<Vec<Told>> {
    for _ in 0..TRIES {
        let reply = match net.any(dice).and_then(|to| net.send(to, order, false)) {
            None => Reply::NotDone,
            Some(answer) => {
                let patience = net.clock.sleep_until(after(net.clock.now(), ANSWER_PATIENCE));
                match select(answer, patience).await {
                    Either::Left((Ok(reply), _)) => reply,
                    Either::Left((Err(_), _)) | Either::Right(_) => Reply::Unknown,
                }
            }
        };
        match reply {
            Reply::Done(told) if failure(&told).is_none() || !order.is_repeatable() => {
                return Some(told);
            }
            Reply::Unknown if !order.is_repeatable() => return None,
            Reply::Done(_) | Reply::Unknown | Reply::Elsewhere | Reply::NotDone => {}
        }
        let pause = Duration::from_millis(100 + dice.below(1_000) as u64);
        net.clock.sleep_until(after(net.clock.now(), pause)).await;
    }
    None
}

/// The error of the journal or the place, if it kept the request from being executed.
fn failure(told: &[Told]) -> Option<StoreError> {
    let News::Answered(answer) = &told.last()?.news else { return None };
    match answer {
        Answer::NotTakenUp(RecoveryError::Journal(error))
        | Answer::State(_, Err(RecoveryError::Journal(error)))
        | Answer::Started(Err(StartError::Journal(error)))
        | Answer::Claimed(_, Err(ClaimError::Journal(error)))
        | Answer::Aborted(Err(error)) => Some(error.clone()),
        Answer::Acted(_, outcomes, _) => {
            let failed = outcomes.iter().map(|outcome| match outcome {
                Err(ActError::Journal(error)) => Some(error.clone()),
                _ => None,
            });
            failed.reduce(Option::and).flatten()
        }
        _ => None,
    }
}
