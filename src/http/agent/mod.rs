//! Routes of a seat: look and act.

pub(super) mod act;
pub(super) mod obs;
pub(super) mod observation;
