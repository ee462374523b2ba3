"""The order in which a client asks planners about a map, as `surefoot work --planner A,B,C` does: rendezvous hashing."""
import sys


def ranking(key, addresses):
    """The addresses of planners in the order in which to try them for the map with the hash `key`."""
    mask = (1 << 64) - 1

    def score(address):
        mixed = 0xCBF29CE484222325  # FNV-1a, scrambled as in SplitMix64
        for byte in f"{key}\n{address}".encode():
            mixed = (mixed ^ byte) * 0x100000001B3 & mask
        mixed = (mixed ^ mixed >> 30) * 0xBF58476D1CE4E5B9 & mask
        mixed = (mixed ^ mixed >> 27) * 0x94D049BB133111EB & mask
        return mixed ^ mixed >> 31

    return sorted(addresses, key=score, reverse=True)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(f"usage: {sys.argv[0]} KEY PLANNER...")
    print("\n".join(ranking(sys.argv[1], sys.argv[2:])))
