//! The machine's first UART (Arm CMSDK APB UART, Cortex-M System Design Kit TRM section 4.3).

use embedded_hal_nb::serial;

const BASE: usize = 0x4000_4000;
const DATA: *mut u32 = BASE as *mut u32;
const STATE: *const u32 = (BASE + 0x04) as *const u32;
const CTRL: *mut u32 = (BASE + 0x08) as *mut u32;
const BAUDDIV: *mut u32 = (BASE + 0x10) as *mut u32;

const TX_FULL: u32 = 1;
const RX_FULL: u32 = 2;

/// The serial port. Writing waits for room: simulated time stands still meanwhile, so the scan does not wait for the link.
#[derive(Debug)]
pub struct Uart(());

impl Uart {
    /// Switches transmitter and receiver on. There is one such UART: make one of these.
    pub fn new() -> Self {
        // SAFETY: registers of the UART, which nothing else uses. 25 MHz / 25 = 1 Mbit/s.
        unsafe {
            BAUDDIV.write_volatile(25);
            CTRL.write_volatile(3);
        }
        Self(())
    }

    fn state(&self) -> u32 {
        // SAFETY: a register without side effects of reading.
        unsafe { STATE.read_volatile() }
    }
}

impl Default for Uart {
    fn default() -> Self {
        Self::new()
    }
}

impl serial::ErrorType for Uart {
    type Error = serial::ErrorKind;
}

impl serial::Read for Uart {
    fn read(&mut self) -> nb::Result<u8, serial::ErrorKind> {
        if self.state() & RX_FULL == 0 {
            return Err(nb::Error::WouldBlock);
        }
        // SAFETY: takes the received byte.
        Ok(unsafe { DATA.cast_const().read_volatile() } as u8)
    }
}

impl serial::Write for Uart {
    fn write(&mut self, byte: u8) -> nb::Result<(), serial::ErrorKind> {
        while self.state() & TX_FULL != 0 {}
        // SAFETY: hands one byte to the transmitter, which has room.
        unsafe { DATA.write_volatile(byte.into()) };
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), serial::ErrorKind> {
        Ok(())
    }
}
