//! `surefoot fleet migrate`: changes the schema of a fleet's database.

/// Prepare what the processes of a fleet share.
#[derive(clap::Subcommand)]
pub enum Command {
    /// Bring the schema of a fleet's database up to date.
    Migrate(Args),
}

/// Bring the schema of a fleet's database up to date, before servers and planners of this version start. Run it with a
/// role that may change tables. A schema that is up to date stays as it is.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  \
        surefoot fleet migrate --store postgres://surefoot_owner:PASSWORD@127.0.0.1/surefoot --role surefoot")]
pub struct Args {
    /// PostgreSQL database that the processes of a fleet share, postgres://user:password@host:port/database
    #[arg(long, value_name = "URL", env = "SUREFOOT_STORE", hide_env_values = true)]
    store: String,
    /// Role of servers and planners. It gets the rights to read and write rows, and none to change tables; default: the
    /// role in --store
    #[arg(long, value_name = "NAME", env = "SUREFOOT_ROLE")]
    role: Option<String>,
}

/// Refuses: this build has no fleet.
#[cfg(not(feature = "fleet"))]
pub fn run(command: &Command) -> anyhow::Result<()> {
    let Command::Migrate(Args { store: _, role: _ }) = command;
    anyhow::bail!("surefoot fleet needs a program that was built with --features fleet")
}

/// Brings the schema up to date, and says which version it has.
#[cfg(feature = "fleet")]
pub fn run(command: &Command) -> anyhow::Result<()> {
    let Command::Migrate(args) = command;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let migrated = runtime.block_on(surefoot_fleet::database::migrate(&args.store, args.role.as_deref()));
    let (place, version) = migrated?;
    println!("{place}: the schema has all migrations up to {version}");
    Ok(())
}
