//! hil-sim.
