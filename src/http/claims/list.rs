//! `GET /api/v1/episodes/{id}/claims`.

use axum::Json;
use swarmbench_engine::AgentId;

use super::super::prelude::*;
use swarmbench_protocol::claim::{SeatHolder, SeatList};

/// List the seats of an episode with their holders.
#[utoipa::path(
    get,
    path = "/api/v1/episodes/{id}/claims",
    operation_id = "list_claims",
    tag = "episodes",
    responses((status = 200, description = "All seats", body = SeatList))
)]
pub(in super::super) async fn list_claims(
    State(app): State<App>,
    caller: Caller,
    Id(id): Id,
    _: Params<Nothing>,
) -> Result<Json<SeatList>, ApiError> {
    let (stored, spec) = app.known_episode(&caller, id).await?;
    let mut held = app.store.held_seats(stored.episode).await?.into_iter().peekable();
    let seat = |agent: AgentId| {
        let name = agent.to_string();
        if let Some(seat) = held.next_if(|seat| seat.agent == agent) {
            let server = seat.player.as_ref().map(|_| SERVER.to_owned());
            return SeatHolder {
                agent: name,
                claim: Some(seat.holder),
                holder: server.or(seat.name),
                model: Some(seat.model),
                player: seat.player,
                claimed_at: Some(seat.claimed_at.into()),
            };
        }
        if spec.open_seats.contains(&agent) {
            return SeatHolder { agent: name, ..SeatHolder::default() };
        }
        // The creator's seats are not stored one by one.
        SeatHolder {
            agent: name,
            claim: Some(0),
            holder: spec.player.as_ref().map(|_| SERVER.to_owned()),
            model: Some(spec.model.clone()),
            player: spec.player.clone(),
            claimed_at: Some(stored.created_at.into()),
        }
    };
    let seats: Vec<SeatHolder> = spec.agents().map(seat).collect();
    let open = seats.iter().filter(|seat| seat.claim.is_none()).count();
    Ok(Json(SeatList { open: u16::try_from(open).expect("at most 1,024 agents"), seats }))
}

/// Holder name of seats that the server plays.
const SERVER: &str = "server";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::http::limits::Limits;
    use crate::keys::NAME_CHARS_MAX;

    #[test]
    fn the_largest_list_of_seats_fits_into_an_answer() {
        let limits = Limits::default();
        let longest = |chars| Some("🐜".repeat(chars));
        let seats = (0..1024).map(|agent| SeatHolder {
            agent: AgentId(agent).to_string(),
            claim: Some(u32::MAX),
            holder: longest(NAME_CHARS_MAX),
            model: longest(limits.name_chars_max),
            player: longest(limits.name_chars_max),
            claimed_at: Some(jiff::Timestamp::MAX.into()),
        });
        let list = SeatList { open: u16::MAX, seats: seats.collect() };
        let bytes = serde_json::to_vec(&list).expect("string keys").len();
        assert!(bytes <= limits.answer_bytes_max, "{bytes}");
    }
}
