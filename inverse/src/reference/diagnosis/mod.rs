//! What is broken on the board or at its wires, told by frames that touches do not explain.
//!
//! Every fault is a hypothesis with physical parameters. Shorts, worse contacts, exchanged wires and stuck multiplexers predict the
//! frame from the electrodes' matrix of the model; open electrodes and wild values leave values free. The hypothesis under which the
//! frame is most probable is named, if it is clearly more probable than touches alone.

mod covariance;
mod evidence;
mod fault;
mod freed;
mod hypotheses;
mod press;

pub(crate) use fault::Faults;
pub use fault::{Electrodes, Fault, MOST_ELECTRODES};
pub(crate) use hypotheses::{
    Diagnosis, LEAK_OHM, LIMITS, PARTS, Search, SearchOfTwo, Told, across, factor, leaked, sense_pairs, spoilt_by,
    values_of,
};
