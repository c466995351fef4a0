//! The whole firmware on this board.
#![no_std]
#![no_main]

use core::cell::Cell;
use cortex_m_rt::entry;
use firmware::{Controller, Memory};
use protocol::Plan;
use template::{Chip, FrontEnd, INFO, Port, Ram, Uart};

#[entry]
fn main() -> ! {
    // What is large: statics, since a stack has no room for them; `entry` lends them to `main` alone.
    static mut MEMORY: Memory = Memory::new();
    static mut SETTINGS: Ram = Ram::new();
    let (port, time) = (Port::new(), Cell::new(0));
    let (Ok(front), Ok(chip)) = (FrontEnd::new(&port, &time), Chip::new(&time, SETTINGS)) else {
        panic!("the board does not start");
    };
    let mut board = match Controller::new(INFO, Plan::sequential(), front, Uart::new(), chip, MEMORY) {
        Ok(board) => board,
        Err(e) => panic!("{e}"),
    };
    loop {
        board.poll();
    }
}
