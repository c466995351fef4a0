//! The parts of a chip that no board's program speaks to.

use rigless::soc::Bus;

/// Kinds of instances of which a program uses few or none, by how their names begin.
const KINDS: [&str; 13] = [
    "TIM", "LPTIM", "SPI", "I2C", "USART", "UART", "LPUART", "OTG", "SDMMC", "BDMA", "DMA", "EXTI", "RNG",
];

/// For each slot, whether its model is left out: of the kinds above all but these.
///
/// A model that is there hears every request of every other one, some twenty for each sample, which took a third of the time of
/// an emulation. An access to a part without its model is a gap of the emulation, which [`crate::run::Outcome::gaps`] tells.
pub(crate) fn unused(bus: &Bus, used: &[&str]) -> Box<[bool]> {
    let left_out = |name: &str| KINDS.iter().any(|k| name.starts_with(k)) && !used.contains(&name);
    bus.slots()
        .iter()
        .map(|slot| left_out(slot.peripheral().name))
        .collect()
}
