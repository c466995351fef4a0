//! Messages.
#![no_std]
