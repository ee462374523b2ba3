//! stub
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let stop = std::sync::atomic::AtomicBool::new(false);
    let mut config = surefoot_agent::train::TrainConfig::default();
    if let Some(lr) = args.get(3) { config.sac.learning_rate = lr.parse().unwrap(); }
    let r = surefoot_agent::train::run(config, std::path::Path::new(&args[1]), args.get(2).map(String::as_str)==Some("resume"), &stop, |line| println!("{line}"));
    println!("{r:?}");
}
