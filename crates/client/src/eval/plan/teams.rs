//! Teams: several players on the seats of one swarm. An entry of an experiment names one team, or a set of them.

use std::collections::BTreeMap;

use swarmbench_engine::TaskName;
use swarmbench_players::{DEFAULT_PLAYER, find};
use swarmbench_protocol::names::BUILT_IN;

use super::problems::Problems;
use super::{Asked, ModelPlan};
use crate::eval::experiment::{
    Experiment, Focal, List, MemberEntry, Numbers, Substitute, TeamEntry,
};

/// Members of a team: the limit of the server.
pub(super) const MEMBERS_MAX: usize = 64;

/// A team: who plays which seats.
#[derive(Clone, Debug, PartialEq)]
pub struct TeamPlan {
    /// The name on boards.
    pub name: String,
    /// The members, in the order of their first seats; each seat has one.
    pub members: Vec<MemberPlan>,
}

/// A member of a team.
#[derive(Clone, Debug, PartialEq)]
pub struct MemberPlan {
    /// The name within the team.
    pub name: String,
    /// The numbers of its agents, in order.
    pub seats: Vec<u16>,
    /// The player.
    pub player: MemberPlayer,
}

/// The player of a member's seats.
#[derive(Clone, Debug, PartialEq)]
pub enum MemberPlayer {
    /// A language model.
    Model(Box<ModelPlan>),
    /// A built-in player, which the server plays: only so it remembers earlier rounds after an interruption, as nobody else may
    /// read what its seats saw.
    BuiltIn(String),
}

impl MemberPlan {
    /// The name of its player on boards.
    pub(in crate::eval) fn shown(&self) -> String {
        match &self.player {
            MemberPlayer::Model(model) => model.name.clone(),
            MemberPlayer::BuiltIn(player) => format!("{BUILT_IN}{player}"),
        }
    }
}

impl TeamPlan {
    /// The members that are language models, with the number of their seats.
    pub fn models(&self) -> impl Iterator<Item = (&MemberPlan, &ModelPlan)> {
        self.members.iter().filter_map(|member| match &member.player {
            MemberPlayer::Model(model) => Some((member, &**model)),
            MemberPlayer::BuiltIn(_) => None,
        })
    }
}

/// Names of models that play in teams, and therefore not alone.
pub(super) fn models_of_teams(experiment: &Experiment) -> Vec<&str> {
    let teams = experiment.teams.iter();
    let names = teams.flat_map(|TeamEntry { members, substitute, focal, .. }| {
        let members = members.iter().filter_map(|member| member.model.as_deref());
        let pair = substitute.iter().flat_map(|pair| [pair.of.as_str(), pair.by.as_str()]);
        let sets = focal.iter().flat_map(|set| set.models.0.iter().chain(&set.backgrounds.0));
        members.chain(pair).chain(sets.map(String::as_str))
    });
    names.collect()
}

/// Makes the teams of an experiment for one combination of settings.
pub(super) struct Teams<'e> {
    pub(super) asked: Asked<'e>,
    /// The number of agents.
    pub(super) agents: u16,
}

impl Teams<'_> {
    /// The teams of all entries.
    pub(super) fn all(&self, problems: &mut Problems) -> Vec<TeamPlan> {
        let entries = self.asked.experiment.teams.iter();
        entries.flat_map(|entry| self.of_entry(entry, problems)).collect()
    }

    /// The number of teams of all entries, before any is made.
    pub(super) fn count(&self) -> u64 {
        let of_entry = |entry: &TeamEntry| match (&entry.substitute, &entry.focal) {
            (Some(Substitute { k: Some(ranges), .. }), _) => size(&ranges.0),
            (Some(_), _) => u64::from(self.agents) + 1,
            (None, Some(set)) => set.backgrounds.0.len() as u64 * (set.models.0.len() as u64 + 1),
            (None, None) => 1,
        };
        self.asked.experiment.teams.iter().map(of_entry).sum()
    }

    fn of_entry(&self, entry: &TeamEntry, problems: &mut Problems) -> Vec<TeamPlan> {
        let TeamEntry { name, members, substitute, focal } = entry;
        match (members.as_slice(), substitute, focal) {
            ([_, ..], None, None) if members.len() > MEMBERS_MAX => {
                let count = members.len();
                problems.add(format!("a team has at most {MEMBERS_MAX} `members`, not {count}"));
                Vec::new()
            }
            ([_, ..], None, None) => {
                let name = name.clone().unwrap_or_else(|| named_after(members));
                self.of_members(&name, members, problems).into_iter().collect()
            }
            ([], Some(pair), None) if name.is_none() => self.curve(pair, problems),
            ([], None, Some(set)) if name.is_none() => self.strangers(set, problems),
            _ => {
                problems.add(
                    "each of `teams` has either `members` (and perhaps a `name`), or `substitute`, or `focal`"
                        .to_owned(),
                );
                Vec::new()
            }
        }
    }

    /// A team for each number of replaced seats: those with the highest numbers.
    fn curve(
        &self,
        Substitute { of, by, k }: &Substitute,
        problems: &mut Problems,
    ) -> Vec<TeamPlan> {
        let all = || (0..=self.agents).collect();
        let counts: Vec<u16> =
            k.as_ref().map_or_else(all, |k| numbers(k, self.agents, "k", problems));
        counts.into_iter().filter_map(|k| self.pair(of, by, k, problems)).collect()
    }

    /// A team of each focal model with each background, and each background alone.
    fn strangers(&self, set: &Focal, problems: &mut Problems) -> Vec<TeamPlan> {
        let Focal { models: List(models), backgrounds: List(backgrounds), seats } = set;
        if *seats == 0 || *seats >= self.agents {
            problems.add(format!(
                "a focal model has 1 to {} of {} seats, not {seats}",
                self.agents.saturating_sub(1),
                self.agents
            ));
        }
        let mut teams = Vec::new();
        for background in backgrounds {
            teams.extend(self.pair(background, background, 0, problems));
            let others = models.iter().filter(|model| *model != background);
            teams.extend(others.filter_map(|model| self.pair(background, model, *seats, problems)));
        }
        teams
    }

    /// A team in which `k` seats of `of`, those with the highest numbers, are played by `by`.
    fn pair(&self, of: &str, by: &str, k: u16, problems: &mut Problems) -> Option<TeamPlan> {
        let kept = self.agents.checked_sub(k)?;
        let member = |player: &str, from: u16, to: u16| {
            let last = to.saturating_sub(1).into();
            let seats = List(vec![Numbers { from: from.into(), last }]);
            let (model, player) = match player.strip_prefix(BUILT_IN) {
                Some(name) => (None, Some(name.to_owned())),
                None => (Some(player.to_owned()), None),
            };
            (from < to).then_some(MemberEntry { name: None, model, player, seats })
        };
        let members = [member(of, 0, kept), member(by, kept, self.agents)];
        let members: Vec<MemberEntry> = members.into_iter().flatten().collect();
        self.of_members(&named_after(&members), &members, problems)
    }

    fn of_members(
        &self,
        name: &str,
        entries: &[MemberEntry],
        problems: &mut Problems,
    ) -> Option<TeamPlan> {
        let mut members: Vec<MemberPlan> = Vec::with_capacity(entries.len());
        let mut holders: BTreeMap<u16, usize> = BTreeMap::new();
        for entry in entries {
            let seats = numbers(&entry.seats, self.agents.saturating_sub(1), "seats", problems);
            for seat in &seats {
                *holders.entry(*seat).or_default() += 1;
            }
            let player = self.player(entry, problems)?;
            let name = entry.name.clone().unwrap_or_else(|| entry.shown());
            if members.iter().any(|other| other.name == name) {
                problems.add(format!(
                    "two members of the team {name:?} have this name: give each a `name` of its own"
                ));
            }
            members.push(MemberPlan { name, seats, player });
        }
        let is_wrong = |seat: &u16| holders.get(seat) != Some(&1);
        if let Some(seat) = (0..self.agents).find(is_wrong) {
            let count = holders.get(&seat).copied().unwrap_or(0);
            problems.add(format!(
                "in the team {name:?} the seat {seat} has {count} members; each of the {} seats has one",
                self.agents
            ));
        }
        members.sort_by_key(|member| member.seats.first().copied());
        Some(TeamPlan { name: name.to_owned(), members })
    }

    fn player(&self, entry: &MemberEntry, problems: &mut Problems) -> Option<MemberPlayer> {
        match (&entry.model, &entry.player) {
            (None, Some(player)) => {
                let unknown = |task: &TaskName| find(player, *task).err();
                if player != DEFAULT_PLAYER
                    && let Some(unknown) = self.asked.tasks.iter().find_map(unknown)
                {
                    problems.add(unknown.to_string());
                }
                Some(MemberPlayer::BuiltIn(player.clone()))
            }
            (Some(name), None) => {
                let models = self.asked.experiment.models.as_ref().map_or(&[][..], |List(all)| all);
                let Some(entry) = models.iter().find(|entry| entry.name == *name) else {
                    problems.add(format!(
                        "a team names the model {name:?}, which is not in `models` (built-in players begin with {BUILT_IN})"
                    ));
                    return None;
                };
                Some(MemberPlayer::Model(Box::new(self.asked.model(entry, problems))))
            }
            _ => {
                problems.add("a member of a team has either a `model` or a `player`".to_owned());
                None
            }
        }
    }
}

impl MemberEntry {
    /// The name of its player on boards.
    fn shown(&self) -> String {
        let built_in = || format!("{BUILT_IN}{}", self.player.as_deref().unwrap_or_default());
        self.model.clone().unwrap_or_else(built_in)
    }
}

/// The name of a team, such as `9 strong + 3 weak`: it follows from its members, so that equal teams are on one row.
fn named_after(members: &[MemberEntry]) -> String {
    let part = |member: &MemberEntry| format!("{} {}", size(&member.seats.0), member.shown());
    members.iter().map(part).collect::<Vec<_>>().join(" + ")
}

/// How many numbers ranges have.
pub(super) fn size(ranges: &[Numbers]) -> u64 {
    ranges.iter().map(|range| range.last.saturating_sub(range.from) + 1).sum()
}

/// The numbers of ranges, sorted, each at most `most`.
fn numbers(ranges: &List<Numbers>, most: u16, what: &str, problems: &mut Problems) -> Vec<u16> {
    let List(ranges) = ranges;
    if let Some(range) = ranges.iter().find(|range| range.last > most.into()) {
        problems.add(format!("`{what}` of a team goes to {most}, and has {}", range.last));
    }
    let all = ranges.iter().flat_map(|range| range.from..=range.last.min(most.into()));
    // Of seats, more than there are agents have one twice.
    let all = all.filter_map(|number| u16::try_from(number).ok());
    let mut all: Vec<u16> = all.take(usize::from(u16::MAX)).collect();
    all.sort_unstable();
    all
}
