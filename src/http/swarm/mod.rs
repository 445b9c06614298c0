//! Many seats in one call.

pub(super) mod act;
pub(super) mod obs;
