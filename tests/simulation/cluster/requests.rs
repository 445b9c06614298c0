//! Requests on their way: a server answers or forwards them, and clients retry.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use futures::future::{Either, select};
use swarmbench::cluster::Incarnation;
use swarmbench::cluster::route::{Driver, End, Route, Sender, Sent, Target, follow};
use swarmbench::episode::actor::{ActError, ClaimError, StartError};
use swarmbench::episode::recovery::RecoveryError;
use swarmbench::ids::{EpisodeId, Place};
use swarmbench::membership::{self, Port as _};
use swarmbench::store::StoreError;
use swarmbench_clock::{Clock as _, after};
use swarmbench_testkit::worlds::Dice;
use tokio::sync::oneshot;

use super::{Net, Peer, Reply, Site};
use crate::simulation::clients::{News, Request, RequestId, SimAnswer, Told, serve, think};

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
    /// True if the request may be sent twice: it only reads, or it is an act, which is idempotent.
    const fn is_repeatable(&self) -> bool {
        !matches!(
            self.request,
            Request::Create(..) | Request::Claim(_) | Request::Start | Request::Abort
        )
    }
}

/// Answers a request at a server, unless its sender goes away.
pub(super) async fn answer(
    net: Arc<Net>,
    peer: Arc<Peer>,
    order: Order,
    is_hop: bool,
    mut done: oneshot::Sender<Reply>,
) {
    let reply = {
        let answering = std::pin::pin!(front(&net, &peer, &order, is_hop));
        match select(answering, std::pin::pin!(done.closed())).await {
            Either::Left((reply, _)) => reply,
            Either::Right(_) => return,
        }
    };
    drop(done.send(reply));
}

async fn front(net: &Arc<Net>, peer: &Arc<Peer>, order: &Order, is_hop: bool) -> Reply {
    if !peer.answers() {
        return Reply::NotDone;
    }
    let target = match &order.request {
        Request::Create(..) => Target::New(order.number.into()),
        _ => peer.place_of(&order.id).await.map_or(Target::Anybody, Target::Place),
    };
    let sender = if is_hop {
        Sender::Server
    } else {
        Sender::Client { is_repeatable: order.is_repeatable(), may_resend: true }
    };
    let site = Site { net: Arc::clone(net), peer: Arc::clone(peer) };
    let mut way = Way { site, order, reply: Reply::NotDone };
    match follow(Route::new(target, sender), &mut way).await {
        Ok(End::Here) => here(net, peer, order, is_hop).await,
        Ok(End::Answered) => way.reply,
        Ok(End::Elsewhere) => Reply::Elsewhere,
        Ok(End::Unknown) => Reply::Unknown,
        Ok(End::Moved) | Err(_) => Reply::NotDone,
    }
}

/// A request on its way.
struct Way<'a> {
    site: Site,
    order: &'a Order,
    /// The reply of another server.
    reply: Reply,
}

impl Driver for Way<'_> {
    type View = Peer;
    type Error = StoreError;

    fn view(&self) -> &Peer {
        &self.site.peer
    }

    fn now(&self) -> Duration {
        self.site.peer.time()
    }

    async fn owner(&mut self, place: Place) -> Result<Option<Incarnation>, StoreError> {
        Ok(self.site.peer.journal.at_database(|tables| tables.owner(place)).await)
    }

    async fn is_unfinished(&mut self, place: Place) -> Result<bool, StoreError> {
        Ok(self.site.peer.journal.at_database(|tables| tables.is_unfinished(place)).await)
    }

    async fn take(&mut self, place: Place) -> Result<Option<Incarnation>, StoreError> {
        self.site.peer.journal.take_place(place).await.map(Some)
    }

    async fn send(&mut self, to: Incarnation) -> Result<Sent, StoreError> {
        let Some(answer) = self.site.net.send(to, self.order, true) else {
            return Ok(Sent::NotSent);
        };
        Ok(match answer.await {
            Ok(Reply::Elsewhere) => Sent::Elsewhere,
            Ok(reply) => {
                self.reply = reply;
                Sent::Answered
            }
            Err(_) => Sent::Unknown,
        })
    }

    async fn exclude_if_dead(&mut self, server: Incarnation) -> Result<(), StoreError> {
        membership::exclude_if_dead(&self.site, server).await
    }

    async fn pause(&mut self, pause: Duration) {
        self.site.sleep(pause).await;
    }
}

/// Answers at this server.
async fn here(net: &Net, peer: &Peer, order: &Order, is_hop: bool) -> Reply {
    let buffer = Mutex::new(Vec::new());
    let say = |news| {
        let told = Told {
            number: order.number,
            id: order.id.clone(),
            server: peer.incarnation,
            plays: peer.plays(&order.id),
            news,
        };
        if matches!(told.news, News::Arrived(_)) {
            net.desk.lock().expect("one thread").push_back(told);
        } else {
            buffer.lock().expect("one thread").push(told);
        }
    };
    serve(&peer.registry, &net.clock, say, order.id.clone(), order.request.clone()).await;
    if !peer.answers() {
        return Reply::Unknown;
    }
    let told = buffer.into_inner().expect("one thread");
    match failure(&told) {
        Some(StoreError::Elsewhere) if is_hop => Reply::Elsewhere,
        Some(StoreError::Elsewhere) => Reply::NotDone,
        _ => Reply::Done(told),
    }
}

impl Peer {
    /// True if this server plays an episode, or nobody does as it has ended or does not exist.
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
    let news = News::Answered(SimAnswer::Away);
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
        SimAnswer::NotTakenUp(RecoveryError::Journal(error))
        | SimAnswer::State(_, Err(RecoveryError::Journal(error)))
        | SimAnswer::Started(Err(StartError::Journal(error)))
        | SimAnswer::Claimed(_, Err(ClaimError::Journal(error)))
        | SimAnswer::Aborted(Err(error)) => Some(error.clone()),
        SimAnswer::Acted(_, outcomes, _) => {
            let failed = outcomes.iter().map(|outcome| match outcome {
                Err(ActError::Journal(error)) => Some(error.clone()),
                _ => None,
            });
            failed.reduce(Option::and).flatten()
        }
        _ => None,
    }
}
