//! Routes of a seat: look and act.

pub(super) mod act;
pub(super) mod look;
pub(super) mod obs;
