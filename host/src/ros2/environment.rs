//! What ROS 2 is told by variables of the environment, as all its nodes read them.

use anyhow::{Result, bail};
use std::net::{IpAddr, Ipv4Addr};

/// Where nodes are looked for, and how.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Network {
    pub(super) domain: u16,
    /// Only on this computer.
    pub(super) local: bool,
    /// Octets of an entity's number in `ros_discovery_info`: Iron and later have 16, releases before it 24.
    pub(super) gid: usize,
}

/// The ports of later domains are beyond 65535 (DDSI-RTPS 9.6.1.1).
const LAST_DOMAIN: u16 = 232;

impl Network {
    /// As the environment says.
    ///
    /// # Errors
    /// A variable says what cannot be.
    pub(super) fn of(variable: impl Fn(&str) -> Option<String>) -> Result<Self> {
        let variable = |name| variable(name).filter(|value| !value.is_empty());
        let domain = match variable("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => match text.parse() {
                Ok(domain) if domain <= LAST_DOMAIN => domain,
                _ => bail!("ROS_DOMAIN_ID={text}: give a number from 0 to {LAST_DOMAIN}"),
            },
        };
        let range = variable("ROS_AUTOMATIC_DISCOVERY_RANGE");
        // The older variable goes first where it is set, as in ROS 2 itself.
        let only = variable("ROS_LOCALHOST_ONLY").is_some_and(|value| value == "1");
        let local = match range.as_deref() {
            _ if only => true,
            Some("LOCALHOST") => true,
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => false,
            Some(other) => bail!("ROS_AUTOMATIC_DISCOVERY_RANGE={other}: give SUBNET or LOCALHOST"),
        };
        if variable("ROS_STATIC_PEERS").is_some() {
            bail!(
                "ROS_STATIC_PEERS: peers behind a router cannot be named; unset it, and let a node of ROS 2 bridge the networks"
            );
        }
        let distribution = variable("ROS_DISTRO");
        let old = ["foxy", "galactic", "humble"];
        let gid = if distribution.is_some_and(|name| old.contains(&name.as_str())) {
            24
        } else {
            16
        };
        Ok(Self { domain, local, gid })
    }

    /// The only networks to use; none for all.
    pub(super) fn only(&self) -> Option<[IpAddr; 1]> {
        self.local.then_some([IpAddr::V4(Ipv4Addr::LOCALHOST)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(set: &[(&str, &str)]) -> Result<Network> {
        let set: Vec<(String, String)> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Network::of(move |name| set.iter().find(|(key, _)| key == name).map(|(_, value)| value.clone()))
    }

    #[test]
    fn variables_mean_what_they_mean_to_other_nodes() {
        let usual = Network {
            domain: 0,
            local: false,
            gid: 16,
        };
        assert_eq!(of(&[]).unwrap(), usual);
        assert_eq!(of(&[("ROS_DOMAIN_ID", "")]).unwrap(), usual);
        assert_eq!(of(&[("ROS_DOMAIN_ID", "42")]).unwrap().domain, 42);
        assert!(of(&[("ROS_LOCALHOST_ONLY", "1")]).unwrap().local);
        assert!(!of(&[("ROS_LOCALHOST_ONLY", "0")]).unwrap().local);
        assert!(of(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")]).unwrap().local);
        assert_eq!(of(&[("ROS_DISTRO", "humble")]).unwrap().gid, 24);
        assert_eq!(of(&[("ROS_DISTRO", "jazzy")]).unwrap().gid, 16);
        for wrong in [
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_DOMAIN_ID", "-1"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
            ("ROS_STATIC_PEERS", "10.0.0.1"),
        ] {
            let why = of(&[wrong]).unwrap_err().to_string();
            assert!(why.starts_with(wrong.0), "{why}");
        }
    }
}
