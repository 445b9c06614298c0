//! Keys for people: created, listed and revoked by organizers.

pub(super) mod create;
pub(super) mod list;
pub(super) mod own;
pub(super) mod revoke;
