//! Where the frames of `skin run` come from: a board, which is waited for when it goes away, or the simulated skin.

use crate::board;
use crate::run_arguments::SourceArguments;
use crate::say::say;
use crate::simulated_skin;
use ::forward::Sheet;
use anyhow::{Context, Result, anyhow};
use hil_sim::{SceneFile, SimPort};
use link::plans::PlanChoice;
use link::ports::Place;
use link::{Link, Port, Reopen, Session};
use protocol::{Hello, Plan, PlanError};
use recording::Switch;

/// A board that streams.
pub(crate) struct Source {
    pub(crate) session: Session,
    pub(crate) name: String,
    /// The simulated skin's port: its scene is held.
    pub(crate) scene: Option<SimPort>,
}

/// A session by a port that is opened again when it is gone, and whose bytes are recorded while they are to be.
fn session(
    port: Box<dyn Port>,
    mut reopen: Reopen,
    switch: &Switch,
    choose: impl FnOnce(&Hello) -> Result<Plan, PlanError>,
) -> Result<Session> {
    let switch = switch.clone();
    let tapped = move |port: Box<dyn Port>| -> Box<dyn Port> { Box::new(switch.port(port)) };
    let first = tapped(port);
    let link = Link::reopening(first, Box::new(move || reopen().map(&tapped)))?;
    Ok(Session::start_on(link, choose)?)
}

/// How a simulated board's port is opened again.
fn again(port: &SimPort) -> Reopen {
    let port = port.clone();
    Box::new(move || {
        let again = port.reopen().map_err(|e| e.to_string())?;
        Ok(Box::new(again) as Box<dyn Port>)
    })
}

/// The simulated skin, its scene held; without a scene the demo.
///
/// # Errors
/// It does not start, or the plan is none for it.
pub(crate) fn simulated(
    arguments: &SourceArguments,
    sheet: &Sheet,
    scene: Option<&SceneFile>,
    switch: &Switch,
) -> Result<Source> {
    let demo = || SceneFile::demo(sheet.clone());
    let port = simulated_skin::start_held(scene.unwrap_or(&demo()))?;
    // What a scene says itself is only overruled by a plan that is asked for.
    let own = scene.and_then(|scene| scene.config.plan.clone());
    let plan = own.filter(|_| arguments.plan == PlanChoice::Auto);
    let choose = |hello: &Hello| plan.map_or_else(|| arguments.plan.plan(hello), Ok);
    Ok(Source {
        session: session(Box::new(port.clone()), again(&port), switch, choose)?,
        name: match scene {
            None => "simulated skin".to_owned(),
            Some(scene) if scene.title.is_empty() => "simulated skin: scene".to_owned(),
            Some(scene) => format!("simulated skin: {}", scene.title),
        },
        scene: Some(port),
    })
}

/// The board at the port that is asked for, or the only one on USB; the inner error says why there is none.
///
/// # Errors
/// A port that does not open, a board that does not answer, or there are several.
pub(crate) fn board(arguments: &SourceArguments, switch: &Switch) -> Result<Result<Source, String>> {
    let start = |place: &Place| -> Result<Source> {
        let port = place.open().map_err(|e| anyhow!(e))?;
        let choose = |hello: &Hello| arguments.plan.plan(hello);
        Ok(Source {
            session: session(port, place.reopen(), switch, choose).with_context(|| place.path().to_owned())?,
            name: place.path().to_owned(),
            scene: None,
        })
    };
    match &arguments.port {
        Some(path) => start(&Place::of(path)).map(Ok),
        None => board::only(arguments.serial.as_deref(), start),
    }
}

/// The board asked for, the only one there is, or the simulated skin.
///
/// # Errors
/// The port does not open, the board does not answer, or there are several.
pub(crate) fn connect(
    arguments: &SourceArguments,
    sheet: &Sheet,
    scene: Option<&SceneFile>,
    switch: &Switch,
) -> Result<Source> {
    if scene.is_none() && !(arguments.simulate && arguments.port.is_none()) {
        match board(arguments, switch)? {
            Ok(source) => return Ok(source),
            Err(why) if arguments.serial.is_some() => return Err(anyhow!("{why}; skin list shows what there is")),
            Err(why) => {
                say!(
                    "no board found ({why}): showing the simulated skin; name a port with --port if there is one, skin list tells more"
                );
            }
        }
    }
    simulated(arguments, sheet, scene, switch)
}
