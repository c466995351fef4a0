//! Serial ports on USB, where a board may be.

use crate::printable::printable;
use serialport::{SerialPortInfo, SerialPortType, UsbPortInfo};

/// USB's numbers of the adapters that a board may have (docs/board.md), likeliest first: vendor and products.
const ADAPTERS: [(u16, &[u16]); 3] = [
    // FTDI: FT232R, FT2232, FT4232, FT232H, FT-X.
    (0x0403, &[0x6001, 0x6010, 0x6011, 0x6014, 0x6015]),
    // ST-LINK/V2-1 and V3 with a serial port, as on a Nucleo.
    (
        0x0483,
        &[0x374b, 0x3752, 0x374e, 0x374f, 0x3753, 0x3754, 0x3755, 0x3757],
    ),
    // Silicon Labs: CP210x.
    (0x10c4, &[0xea60, 0xea63, 0xea70, 0xea71]),
];

/// A serial port on USB.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UsbPort {
    /// Its name, such as /dev/ttyUSB0.
    pub path: String,
    /// USB's number of the vendor.
    pub vendor: u16,
    /// USB's number of the product.
    pub product: u16,
    /// Serial number of the adapter, where it has one.
    pub serial: Option<String>,
    /// What the adapter says to be.
    pub name: Option<String>,
    /// Whether it is an adapter that a board may have. Others must not be sent anything unless somebody names them.
    pub likely: bool,
}

/// What to say of ports that are not asked, to be added to a sentence.
pub fn left_alone(ports: &[UsbPort]) -> String {
    let others: Vec<String> = ports
        .iter()
        .filter(|p| !p.likely)
        .map(|p| format!("{} ({:04x}:{:04x})", p.path, p.vendor, p.product))
        .collect();
    if others.is_empty() {
        return String::new();
    }
    format!("; not asked, as they are of other devices: {}", others.join(", "))
}

/// The serial ports on USB of this computer, likeliest first.
///
/// # Errors
/// The system's, when it cannot list its ports.
pub fn usb_ports() -> Result<Vec<UsbPort>, serialport::Error> {
    // Some containers have no such folder, and the listing needs it.
    if cfg!(target_os = "linux") && !std::path::Path::new("/sys/class/tty").exists() {
        return Ok(Vec::new());
    }
    Ok(sorted(serialport::available_ports()?))
}

fn sorted(mut ports: Vec<SerialPortInfo>) -> Vec<UsbPort> {
    // macOS lists every port twice: for calls from here (cu), and for those to here (tty).
    let called: Vec<String> = ports.iter().map(|p| p.port_name.clone()).collect();
    ports.retain(|port| {
        let name = port.port_name.strip_prefix("/dev/tty.");
        name.is_none_or(|name| !called.contains(&format!("/dev/cu.{name}")))
    });
    let rank = |usb: &UsbPortInfo| ADAPTERS.iter().position(|(v, p)| *v == usb.vid && p.contains(&usb.pid));
    let mut out: Vec<(usize, UsbPort)> = ports
        .into_iter()
        .filter_map(|port| {
            let SerialPortType::UsbPort(usb) = port.port_type else {
                return None;
            };
            let rank = rank(&usb);
            let port = UsbPort {
                path: port.port_name,
                vendor: usb.vid,
                product: usb.pid,
                serial: usb.serial_number.as_deref().map(printable),
                name: usb.product.as_deref().map(printable),
                likely: rank.is_some(),
            };
            Some((rank.unwrap_or(ADAPTERS.len()), port))
        })
        .collect();
    out.sort_by_key(|(rank, _)| *rank);
    out.into_iter().map(|(_, port)| port).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_udev_rules_are_of_the_same_adapters() {
        let rules = include_str!("../../contrib/70-skin.rules");
        for (vendor, products) in ADAPTERS {
            let line = rules
                .lines()
                .find(|l| l.contains(&format!("=={:?}", format!("{vendor:04x}"))));
            let list = line
                .unwrap()
                .split("idProduct}==\"")
                .nth(1)
                .unwrap()
                .split('"')
                .next()
                .unwrap();
            let mut named: Vec<u16> = list.split('|').map(|p| u16::from_str_radix(p, 16).unwrap()).collect();
            let mut known = products.to_vec();
            named.sort_unstable();
            known.sort_unstable();
            assert_eq!(named, known);
        }
    }

    fn usb(name: &str, vid: u16, pid: u16) -> SerialPortInfo {
        SerialPortInfo {
            port_name: name.to_owned(),
            port_type: SerialPortType::UsbPort(UsbPortInfo {
                vid,
                pid,
                serial_number: None,
                manufacturer: None,
                product: None,
            }),
        }
    }

    #[test]
    fn a_port_with_two_names_is_one() {
        let names = [
            "/dev/cu.usbserial-1410",
            "/dev/tty.usbserial-1410",
            "/dev/tty.alone",
            "/dev/ttyUSB0",
        ];
        let found = sorted(names.map(|name| usb(name, 0x0403, 0x6001)).to_vec());
        let found: Vec<&str> = found.iter().map(|p| p.path.as_str()).collect();
        assert_eq!(found, ["/dev/cu.usbserial-1410", "/dev/tty.alone", "/dev/ttyUSB0"]);
    }

    #[test]
    fn only_adapters_that_a_board_may_have_are_greeted() {
        let found = sorted(vec![
            usb("cp2102", 0x10c4, 0xea60),
            usb("arduino", 0x2341, 0x0043),
            usb("nucleo", 0x0483, 0x374b),
            usb("a dfu device of the same maker", 0x0483, 0x5740),
            usb("ft232rl", 0x0403, 0x6001),
            SerialPortInfo {
                port_name: "no usb".to_owned(),
                port_type: SerialPortType::PciPort,
            },
        ]);
        let likely: Vec<&str> = found.iter().filter(|p| p.likely).map(|p| p.path.as_str()).collect();
        assert_eq!(likely, ["ft232rl", "nucleo", "cp2102"]);
        assert_eq!(
            left_alone(&found),
            "; not asked, as they are of other devices: arduino (2341:0043), a dfu device of the same maker (0483:5740)"
        );
    }
}
