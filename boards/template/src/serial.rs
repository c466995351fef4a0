//! The machine's first UART (Arm CMSDK APB UART, Cortex-M System Design Kit TRM section 4.3).

use embedded_hal_nb::serial;

/// UART0 of the machine (Arm application note AN386).
const BASE: usize = 0x4000_4000;
const DATA: *mut u32 = BASE as *mut u32;
const STATE: *const u32 = (BASE + 0x04) as *const u32;
const CTRL: *mut u32 = (BASE + 0x08) as *mut u32;
const BAUDDIV: *mut u32 = (BASE + 0x10) as *mut u32;

/// Bits of `STATE`: the transmitter's buffer, or the receiver's, is full.
const TX_FULL: u32 = 1 << 0;
const RX_FULL: u32 = 1 << 1;
/// Bits of `CTRL`: transmitter on, receiver on.
const TX_ENABLE: u32 = 1 << 0;
const RX_ENABLE: u32 = 1 << 1;

/// Clock of the machine's peripherals, Hz.
const CLOCK_HZ: u32 = 25_000_000;
/// Bits a second.
const BAUD: u32 = 1_000_000;

/// The serial port. Writing waits for room: simulated time stands still meanwhile, so the scan does not wait for the
/// link.
#[derive(Debug)]
pub struct Uart(());

impl Uart {
    /// Switches transmitter and receiver on. There is one such UART: make one of these.
    pub fn new() -> Self {
        // SAFETY: the machine has these registers at these addresses. Only this module uses them, and they take these
        // values.
        unsafe {
            BAUDDIV.write_volatile(CLOCK_HZ / BAUD);
            CTRL.write_volatile(TX_ENABLE | RX_ENABLE);
        }
        Self(())
    }

    fn state(&self) -> u32 {
        // SAFETY: the machine has this register at this address, and reading it has no side effect.
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
        // SAFETY: the machine has this register at this address. Reading it takes the received byte, which is what this
        // is for.
        Ok(unsafe { DATA.cast_const().read_volatile() } as u8)
    }
}

impl serial::Write for Uart {
    fn write(&mut self, byte: u8) -> nb::Result<(), serial::ErrorKind> {
        while self.state() & TX_FULL != 0 {}
        // SAFETY: the machine has this register at this address. The write hands one byte to the transmitter, which has
        // room.
        unsafe { DATA.write_volatile(byte.into()) };
        Ok(())
    }

    fn flush(&mut self) -> nb::Result<(), serial::ErrorKind> {
        Ok(())
    }
}
