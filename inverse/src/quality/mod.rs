//! What can be believed of a frame: noise by reciprocity, faults of electrodes, contacts that changed, doubts.

pub mod contact;
pub mod doubt;
pub(crate) mod fault_monitor;
pub mod faults;
pub(crate) mod flickers;
mod loose_contacts;
pub(crate) mod rails;
pub mod reciprocity;
pub(crate) mod repeats;
pub(crate) mod wild;
