//! In the very program that is flashed, no chain of calls leads to the panic handler from what runs for every block of
//! samples and for every frame. The calls are read from its instructions (ARM DDI 0403, A7.7: B, BL, BLX, BX).

use crate::common::program;
use object::{Object, ObjectSection, ObjectSymbol, SymbolKind};
use std::collections::{BTreeMap, BTreeSet};

/// Where every panic ends.
const HANDLER: &str = "rust_begin_unwind";

struct Code {
    /// First address and what is there: a function's length and name.
    functions: BTreeMap<u64, (u64, String)>,
    /// From here on: data between the instructions, or not.
    data: BTreeMap<u64, bool>,
    text: Vec<u8>,
    base: u64,
}

impl Code {
    fn read(name: &str) -> Self {
        let bytes = std::fs::read(program(name)).unwrap();
        let file = object::File::parse(&*bytes).unwrap();
        let section = file.section_by_name(".text").unwrap();
        let (mut functions, mut data) = (BTreeMap::new(), BTreeMap::new());
        for symbol in file.symbols() {
            let (name, address) = (symbol.name().unwrap_or_default(), symbol.address() & !1);
            if symbol.kind() == SymbolKind::Text && symbol.size() > 0 {
                functions.insert(address, (symbol.size(), name.to_owned()));
            } else if name.starts_with("$d") || name.starts_with("$t") {
                data.insert(address, name.starts_with("$d"));
            }
        }
        Self {
            functions,
            data,
            text: section.data().unwrap().to_vec(),
            base: section.address(),
        }
    }

    fn half(&self, address: u64) -> Option<u32> {
        let at = usize::try_from(address.checked_sub(self.base)?).ok()?;
        let [low, high] = *self.text.get(at..at + 2)?.as_array()?;
        Some(u16::from_le_bytes([low, high]).into())
    }

    /// The function that an address is in.
    fn holding(&self, address: u64) -> Option<u64> {
        let (start, (size, _)) = self.functions.range(..=address).next_back()?;
        (address < start + size).then_some(*start)
    }

    /// Functions that a function calls or goes on to; `None` for one that is only known while it runs.
    fn calls(&self, function: u64) -> BTreeSet<Option<u64>> {
        let (mut at, end) = (function, function + self.functions[&function].0);
        let mut out = BTreeSet::new();
        while at < end {
            if self.data.range(..=at).next_back().is_some_and(|(_, data)| *data) {
                at += 2;
                continue;
            }
            let Some(first) = self.half(at) else { break };
            let long = first >> 11 >= 0b11101;
            let second = if long { self.half(at + 2).unwrap_or(0) } else { 0 };
            let offset = if long {
                long_branch(first, second)
            } else {
                short_branch(first)
            };
            match offset {
                Branch::None => {}
                Branch::Unknown => _ = out.insert(None),
                Branch::To(offset) => {
                    let target = self.holding(at.wrapping_add(4).wrapping_add_signed(offset));
                    if target != Some(function) {
                        out.insert(target);
                    }
                }
            }
            at += if long { 4 } else { 2 };
        }
        out
    }

    /// What of `wanted` is reached from the functions with `roots` in their names, with the way there.
    fn reached(&self, roots: &str, wanted: impl Fn(Option<&str>) -> bool) -> Vec<String> {
        let name = |f: &u64| self.functions[f].1.as_str();
        let mut ways: BTreeMap<Option<u64>, String> = BTreeMap::new();
        let start = self.functions.keys().filter(|f| name(f).contains(roots));
        let mut open: Vec<(Option<u64>, String)> = start.map(|f| (Some(*f), String::new())).collect();
        assert!(!open.is_empty(), "no function {roots}");
        while let Some((function, way)) = open.pop() {
            let known = function.as_ref().map(name);
            let way = format!("{way} -> {}", known.unwrap_or("somewhere"));
            if ways.insert(function, way.clone()).is_none()
                && let Some(f) = function
            {
                let calls = self.calls(f).into_iter();
                open.extend(calls.filter(|c| !ways.contains_key(c)).map(|c| (c, way.clone())));
            }
        }
        println!("{roots}: {} functions reached", ways.len());
        let found = ways.into_iter().filter(|(f, _)| wanted(f.as_ref().map(name)));
        found.map(|(_, way)| way).collect()
    }
}

enum Branch {
    None,
    To(i64),
    Unknown,
}

/// The lowest bits as a signed number.
fn signed(value: u32, bits: u32) -> i64 {
    i64::from((value << (32 - bits)) as i32 >> (32 - bits))
}

fn short_branch(first: u32) -> Branch {
    match first {
        // B, with a condition (14 and 15 are others) and without.
        0xD000..=0xDDFF => Branch::To(signed(first & 0xFF, 8) * 2),
        0xE000..=0xE7FF => Branch::To(signed(first & 0x7FF, 11) * 2),
        // BX and BLX by a register, BX LR being the return.
        0x4700..=0x47FF if first != 0x4770 => Branch::Unknown,
        _ => Branch::None,
    }
}

fn long_branch(first: u32, second: u32) -> Branch {
    let (s, j1, j2) = (first >> 10 & 1, second >> 13 & 1, second >> 11 & 1);
    match (first & 0xF800, second & 0xD000) {
        // B, and BL.
        (0xF000, 0x9000 | 0xD000) => {
            let (i1, i2) = (1 ^ j1 ^ s, 1 ^ j2 ^ s);
            let offset = s << 23 | i1 << 22 | i2 << 21 | (first & 0x3FF) << 11 | second & 0x7FF;
            Branch::To(signed(offset, 24) * 2)
        }
        // B with a condition.
        (0xF000, 0x8000) if first >> 6 & 15 < 14 => {
            let offset = s << 19 | j2 << 18 | j1 << 17 | (first & 0x3F) << 11 | second & 0x7FF;
            Branch::To(signed(offset, 20) * 2)
        }
        _ => Branch::None,
    }
}

#[test]
fn nothing_that_runs_for_every_block_or_frame_can_panic() {
    for name in ["f446", "f427", "f405", "st-link"] {
        let code = Code::read(name);
        let bad = |f: Option<&str>| f.is_none_or(|f| f.contains(HANDLER));
        assert_eq!(code.reached("7measure", bad), Vec::<String>::new(), "{name}");
        // The search does find one where there is one: the start can fail.
        assert!(!code.reached("__cortex_m_rt_main", bad).is_empty(), "{name}");
    }
}
