//! The way of one request through a cluster: which server answers it, and what follows where that one does not.
//!
//! [`Route`] takes in what happened and says what is to be done; [`follow`] does it with a [`Driver`].

use std::time::Duration;

use super::Incarnation;
use crate::ids::Place;

/// Longest wait of a request for another server to take over a place.
pub const MOVE_PATIENCE: Duration = Duration::from_millis(1500);

/// Interval between attempts to locate the owner while a request waits.
pub const MOVE_PAUSE: Duration = Duration::from_millis(25);

/// Part of a request's meaning that decides which server answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Any server handles the request.
    Anybody,
    /// The owner of the place handles the request.
    Place(Place),
    /// The request creates something that must not be created twice: the number is a hash of its idempotency key.
    Named(u64),
    /// The request creates something else: any server that takes places does that, or else the one preferred for this number.
    New(u64),
}

/// Knowledge of a server about its cluster at one moment, without asking the database.
pub trait View {
    fn me(&self) -> Incarnation;
    /// Whether this server takes places.
    fn takes_places(&self) -> bool;
    /// Whether this server owns a place and is not releasing it.
    fn has(&self, place: Place) -> bool;
    fn is_in_cluster(&self, server: Incarnation) -> bool;
    /// Server that should take something with a number; `None` if no server takes places.
    fn preferred(&self, number: u64) -> Option<Incarnation>;
    /// Owner of a place as it was read last.
    fn known_owner(&self, place: Place) -> Option<Owner>;
    fn note_owner(&self, place: Place, owner: Owner);
    fn forget_owner(&self, place: Place);
}

/// Owner of a place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Owner {
    Server(Incarnation),
    /// Everything there has ended: any server answers from the database.
    Nobody,
}

/// Next step of a route, for its driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Read the owner of the place: [`Event::Owner`].
    ReadOwner(Place),
    /// Read whether the place has unfinished work: [`Event::Unfinished`].
    ReadUnfinished(Place),
    /// Take the place unless another server owns it: [`Event::Taken`].
    Take(Place),
    /// Forward the request: [`Event::Sent`].
    Send(Incarnation),
    /// Exclude a server if its process is gone, which frees its places at once: [`Event::Buried`].
    Bury(Incarnation),
    /// Wait: [`Event::Paused`].
    Pause(Duration),
    End(End),
}

/// End of a route.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// This server handles the request.
    Here,
    /// The answer that was received last is the answer to the request.
    Answered,
    /// Another server owns the place: said to the server that forwarded the request.
    Elsewhere,
    /// No server answered within [`MOVE_PATIENCE`]. Nothing was executed, or its repetition has the same effect.
    Moved,
    /// Whether the request was executed is unknown.
    Unknown,
}

/// Event since the last step.
#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// The route begins.
    Arrived,
    Owner(Option<Incarnation>),
    Unfinished(bool),
    /// Owner of the place after the attempt to take it; `None` where no row was found.
    Taken(Option<Incarnation>),
    Sent(Sent),
    Buried,
    Paused,
}

/// Outcome of a forwarded request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sent {
    Answered,
    /// The server does not own the place.
    Elsewhere,
    /// The request did not arrive.
    NotSent,
    /// The request may have been executed.
    Unknown,
}

/// Sender of a request, and the effect of sending it again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sender {
    /// Another server, which has located this one: the request is not forwarded again.
    Server,
    Client {
        /// Whether a request that was executed twice has the effect of one: it only reads, or it is an act.
        is_repeatable: bool,
        /// Whether the body is at hand to be sent again, and was not streamed.
        may_resend: bool,
    },
}

/// The state of a route.
#[derive(Clone, Debug)]
pub struct Route {
    target: Target,
    sender: Sender,
    turn: Turn,
}

#[derive(Clone, Copy, Debug)]
enum Turn {
    /// The request was sent to no server, or to this one.
    First(Option<Incarnation>),
    /// The request is sent once more, until this moment at the latest.
    Again {
        before: Incarnation,
        /// Whether the first server did not answer; else it does not own the place.
        is_away: bool,
        until: Duration,
    },
}

impl Route {
    #[must_use]
    pub const fn new(target: Target, sender: Sender) -> Self {
        Self { target, sender, turn: Turn::First(None) }
    }

    /// Takes in an event; returns what is done next. `now` is the time since any moment, the same for all steps.
    ///
    /// # Panics
    ///
    /// If the event is not one of the last step.
    pub fn next(&mut self, view: &impl View, event: Event, now: Duration) -> Step {
        match (event, self.target, self.sender) {
            (Event::Arrived, Target::Place(place), Sender::Server) if !view.has(place) => {
                Step::ReadUnfinished(place)
            }
            (Event::Arrived, _, Sender::Server) => Step::End(End::Here),
            (Event::Arrived | Event::Buried, _, Sender::Client { .. }) => self.locate(view, now),
            (Event::Owner(Some(owner)), Target::Place(place), _) => {
                if owner == view.me() {
                    // A commit whose answer was lost took the place; or the place is being released.
                    return Step::Take(place);
                }
                view.note_owner(place, Owner::Server(owner));
                self.go(view, owner, now)
            }
            (Event::Owner(None), Target::Place(place), _) => Step::ReadUnfinished(place),
            (Event::Unfinished(is_unfinished), Target::Place(place), sender) => {
                self.unowned(view, place, is_unfinished, sender, now)
            }
            (Event::Taken(owner), Target::Place(place), sender) => match owner {
                Some(owner) if owner == view.me() && view.has(place) => Step::End(End::Here),
                _ if sender == Sender::Server => Step::End(End::Elsewhere),
                Some(owner) if owner != view.me() => {
                    view.note_owner(place, Owner::Server(owner));
                    self.go(view, owner, now)
                }
                _ => self.lost(now),
            },
            (Event::Sent(sent), _, Sender::Client { is_repeatable, may_resend }) => {
                self.sent(view, sent, is_repeatable, may_resend, now)
            }
            (Event::Paused, ..) => self.again(view, now),
            (event, ..) => unreachable!("{event:?} is not of the last step of {self:?}"),
        }
    }

    fn locate(&mut self, view: &impl View, now: Duration) -> Step {
        let taker = |number| {
            let is_stopping = |one: &Incarnation| *one == view.me() && !view.takes_places();
            view.preferred(number).filter(|one| !is_stopping(one))
        };
        let found = match self.target {
            Target::Anybody => Some(view.me()),
            Target::New(_) if view.takes_places() => Some(view.me()),
            Target::New(number) | Target::Named(number) => taker(number),
            Target::Place(place) if view.has(place) => Some(view.me()),
            Target::Place(place) => match view.known_owner(place) {
                Some(Owner::Nobody) => Some(view.me()),
                Some(Owner::Server(owner)) if view.is_in_cluster(owner) => Some(owner),
                _ => return Step::ReadOwner(place),
            },
        };
        match found {
            Some(server) => self.go(view, server, now),
            None => self.lost(now),
        }
    }

    /// Next step where no server owns the place.
    fn unowned(
        &mut self,
        view: &impl View,
        place: Place,
        is_unfinished: bool,
        sender: Sender,
        now: Duration,
    ) -> Step {
        if !is_unfinished {
            if sender != Sender::Server {
                view.note_owner(place, Owner::Nobody);
            }
            return Step::End(End::Here);
        }
        if sender == Sender::Server {
            return Step::Take(place);
        }
        match view.preferred(super::number_of(place)).filter(|server| *server != view.me()) {
            // The preferred server takes ownership when the request arrives.
            Some(preferred) => self.go(view, preferred, now),
            None if view.takes_places() => Step::Take(place),
            None => self.lost(now),
        }
    }

    /// The request is for this server.
    fn go(&mut self, view: &impl View, server: Incarnation, now: Duration) -> Step {
        if server == view.me() {
            return Step::End(End::Here);
        }
        if !view.is_in_cluster(server) {
            // The owner has joined at this moment, or is gone.
            self.forget(view);
            return self.lost(now);
        }
        match &mut self.turn {
            Turn::First(to) => *to = Some(server),
            Turn::Again { before, is_away: true, .. } if *before == server => {
                return self.lost(now);
            }
            Turn::Again { .. } => {}
        }
        Step::Send(server)
    }

    fn sent(
        &mut self,
        view: &impl View,
        sent: Sent,
        is_repeatable: bool,
        may_resend: bool,
        now: Duration,
    ) -> Step {
        let before = match (sent, self.turn) {
            (Sent::Answered, _) => return Step::End(End::Answered),
            (Sent::Unknown, _) if !is_repeatable || !may_resend => {
                self.forget(view);
                return Step::End(End::Unknown);
            }
            (_, Turn::First(Some(before))) if may_resend => before,
            _ => {
                self.forget(view);
                return Step::End(End::Moved);
            }
        };
        self.turn =
            Turn::Again { before, is_away: sent != Sent::Elsewhere, until: now + MOVE_PATIENCE };
        self.again(view, now)
    }

    /// Locates the server once more. A server that did not answer is excluded first if it is dead.
    fn again(&mut self, view: &impl View, now: Duration) -> Step {
        self.forget(view);
        match self.turn {
            Turn::Again { before, is_away: true, .. } if view.is_in_cluster(before) => {
                Step::Bury(before)
            }
            _ => self.locate(view, now),
        }
    }

    /// Next step where no server answers: to wait, or to end the route.
    fn lost(&self, now: Duration) -> Step {
        match self.turn {
            Turn::Again { until, .. } if now < until => Step::Pause(MOVE_PAUSE),
            _ => Step::End(End::Moved),
        }
    }

    fn forget(&self, view: &impl View) {
        if let Target::Place(place) = self.target {
            view.forget_owner(place);
        }
    }
}

/// Database, network and clock of a route.
pub trait Driver: Send {
    type View: View;
    type Error;

    fn view(&self) -> &Self::View;
    /// Time since any moment.
    fn now(&self) -> Duration;
    fn owner(
        &mut self,
        place: Place,
    ) -> impl Future<Output = Result<Option<Incarnation>, Self::Error>> + Send;
    fn is_unfinished(
        &mut self,
        place: Place,
    ) -> impl Future<Output = Result<bool, Self::Error>> + Send;
    /// Takes a place unless another server owns it; returns the owner.
    fn take(
        &mut self,
        place: Place,
    ) -> impl Future<Output = Result<Option<Incarnation>, Self::Error>> + Send;
    /// Forwards the request, and keeps the answer.
    fn send(&mut self, to: Incarnation) -> impl Future<Output = Result<Sent, Self::Error>> + Send;
    /// Excludes a server if its process is gone.
    fn exclude_if_dead(
        &mut self,
        server: Incarnation,
    ) -> impl Future<Output = Result<(), Self::Error>> + Send;
    fn pause(&mut self, pause: Duration) -> impl Future<Output = ()> + Send;
}

/// Follows a route to its end.
///
/// # Errors
///
/// The first error of the driver.
pub async fn follow<D: Driver>(mut route: Route, driver: &mut D) -> Result<End, D::Error> {
    let mut event = Event::Arrived;
    loop {
        let step = route.next(driver.view(), event, driver.now());
        event = match step {
            Step::ReadOwner(place) => Event::Owner(driver.owner(place).await?),
            Step::ReadUnfinished(place) => Event::Unfinished(driver.is_unfinished(place).await?),
            Step::Take(place) => Event::Taken(driver.take(place).await?),
            Step::Send(to) => Event::Sent(driver.send(to).await?),
            Step::Bury(server) => {
                driver.exclude_if_dead(server).await?;
                Event::Buried
            }
            Step::Pause(pause) => {
                driver.pause(pause).await;
                Event::Paused
            }
            Step::End(end) => return Ok(end),
        };
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::BTreeMap;

    use super::*;
    use crate::ids::EpisodeKey;

    const PLACE: Place = Place::Game(EpisodeKey(7));
    const ME: Incarnation = 1;
    const NOW: Duration = Duration::from_secs(5);
    const ACT: Sender = Sender::Client { is_repeatable: true, may_resend: true };
    const CREATION: Sender = Sender::Client { is_repeatable: false, may_resend: true };

    /// A server that knows servers 1 to `members`, and prefers the last one.
    struct Known {
        servers: Incarnation,
        takes_places: bool,
        has: bool,
        owners: RefCell<BTreeMap<Place, Owner>>,
    }

    fn known(servers: Incarnation) -> Known {
        Known { servers, takes_places: true, has: false, owners: RefCell::default() }
    }

    impl View for Known {
        fn me(&self) -> Incarnation {
            ME
        }
        fn takes_places(&self) -> bool {
            self.takes_places
        }
        fn has(&self, _: Place) -> bool {
            self.has
        }
        fn is_in_cluster(&self, server: Incarnation) -> bool {
            (1..=self.servers).contains(&server)
        }
        fn preferred(&self, _: u64) -> Option<Incarnation> {
            (self.servers > 0).then_some(self.servers)
        }
        fn known_owner(&self, place: Place) -> Option<Owner> {
            self.owners.borrow().get(&place).copied()
        }
        fn note_owner(&self, place: Place, owner: Owner) {
            self.owners.borrow_mut().insert(place, owner);
        }
        fn forget_owner(&self, place: Place) {
            self.owners.borrow_mut().remove(&place);
        }
    }

    /// The steps of a route to some events.
    fn steps(view: &Known, target: Target, sender: Sender, events: &[Event]) -> Vec<Step> {
        let mut route = Route::new(target, sender);
        events.iter().map(|event| route.next(view, *event, NOW)).collect()
    }

    #[test]
    fn the_owner_of_a_place_is_read_once_and_answers() {
        let view = known(3);
        let events = [Event::Arrived, Event::Owner(Some(2)), Event::Sent(Sent::Answered)];
        let all = steps(&view, Target::Place(PLACE), ACT, &events);
        assert_eq!(all, [Step::ReadOwner(PLACE), Step::Send(2), Step::End(End::Answered)]);
        assert_eq!(steps(&view, Target::Place(PLACE), ACT, &[Event::Arrived]), [Step::Send(2)]);
        let own = Known { has: true, ..known(3) };
        assert_eq!(
            steps(&own, Target::Place(PLACE), ACT, &[Event::Arrived]),
            [Step::End(End::Here)]
        );
    }

    #[test]
    fn a_place_without_an_owner_is_for_the_preferred_server() {
        let unfinished = [Event::Arrived, Event::Owner(None), Event::Unfinished(true)];
        let last = |view: &Known, events: &[Event]| {
            *steps(view, Target::Place(PLACE), ACT, events).last().expect("a step")
        };
        assert_eq!(last(&known(3), &unfinished), Step::Send(3));
        assert_eq!(last(&known(1), &unfinished), Step::Take(PLACE));
        let stopping = Known { takes_places: false, ..known(1) };
        assert_eq!(last(&stopping, &unfinished), Step::End(End::Moved));
        let ended = [Event::Arrived, Event::Owner(None), Event::Unfinished(false)];
        let view = known(3);
        assert_eq!(last(&view, &ended), Step::End(End::Here));
        assert_eq!(last(&view, &[Event::Arrived]), Step::End(End::Here), "it stays so");
    }

    #[test]
    fn a_forwarded_request_is_not_forwarded_again() {
        let events = [Event::Arrived, Event::Unfinished(true), Event::Taken(Some(2))];
        let all = steps(&known(3), Target::Place(PLACE), Sender::Server, &events);
        assert_eq!(
            all,
            [Step::ReadUnfinished(PLACE), Step::Take(PLACE), Step::End(End::Elsewhere)]
        );
        let all = steps(&known(3), Target::New(5), Sender::Server, &[Event::Arrived]);
        assert_eq!(all, [Step::End(End::Here)]);
    }

    #[test]
    fn what_may_have_been_done_is_repeated_only_if_that_changes_nothing() {
        let lost = [Event::Arrived, Event::Owner(Some(2)), Event::Sent(Sent::Unknown)];
        let last =
            |sender| *steps(&known(3), Target::Place(PLACE), sender, &lost).last().expect("a step");
        assert_eq!(last(ACT), Step::Bury(2));
        assert_eq!(last(CREATION), Step::End(End::Unknown));
        let streamed = Sender::Client { is_repeatable: true, may_resend: false };
        assert_eq!(last(streamed), Step::End(End::Unknown));
    }

    #[test]
    fn a_server_that_does_not_answer_is_waited_for_until_another_owns_the_place() {
        let view = known(3);
        let mut route = Route::new(Target::Place(PLACE), ACT);
        let mut next = |event, ms| route.next(&view, event, Duration::from_millis(ms));
        assert_eq!(next(Event::Arrived, 0), Step::ReadOwner(PLACE));
        assert_eq!(next(Event::Owner(Some(2)), 0), Step::Send(2));
        assert_eq!(next(Event::Sent(Sent::NotSent), 1_000), Step::Bury(2));
        assert_eq!(next(Event::Buried, 1_000), Step::ReadOwner(PLACE));
        assert_eq!(next(Event::Owner(Some(2)), 1_000), Step::Pause(MOVE_PAUSE));
        assert_eq!(next(Event::Paused, 2_499), Step::Bury(2));
        assert_eq!(next(Event::Buried, 2_499), Step::ReadOwner(PLACE));
        assert_eq!(next(Event::Owner(Some(3)), 2_499), Step::Send(3));
        assert_eq!(next(Event::Sent(Sent::Unknown), 2_499), Step::End(End::Moved), "sent twice");
        let mut route = Route::new(Target::Place(PLACE), ACT);
        let mut next = |event, ms| route.next(&view, event, Duration::from_millis(ms));
        assert_eq!(next(Event::Arrived, 0), Step::ReadOwner(PLACE));
        assert_eq!(next(Event::Owner(Some(2)), 0), Step::Send(2));
        assert_eq!(next(Event::Sent(Sent::NotSent), 0), Step::Bury(2));
        assert_eq!(next(Event::Buried, 1_500), Step::ReadOwner(PLACE));
        assert_eq!(next(Event::Owner(Some(2)), 1_500), Step::End(End::Moved), "for so long");
    }

    #[test]
    fn creations_with_a_name_go_to_one_server() {
        let all = |target, view: &Known| steps(view, target, CREATION, &[Event::Arrived]);
        assert_eq!(all(Target::New(5), &known(3)), [Step::End(End::Here)]);
        assert_eq!(all(Target::Named(5), &known(3)), [Step::Send(3)]);
        let stopping = Known { takes_places: false, ..known(3) };
        assert_eq!(all(Target::New(5), &stopping), [Step::Send(3)]);
        let alone = Known { takes_places: false, ..known(1) };
        assert_eq!(all(Target::New(5), &alone), [Step::End(End::Moved)]);
    }
}
