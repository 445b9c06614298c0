//! Machines that decide under time, told by hand what happens when.

mod agreement;
mod fair;
mod lockstep;
mod quota;
