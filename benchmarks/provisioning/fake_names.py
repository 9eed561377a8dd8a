"""Names and addresses of simulated robots; shared with the servers, which run in another environment."""


def identity(number: int, name: str) -> tuple[str, str]:
    """Return name and address of a simulated robot: both as long as those of the real one that was recorded.

    An address has 11 characters, as those of the lab's robots from the first to the ninetieth.
    """
    a, b, c = number // 900, number // 90 % 10, number % 90
    return f"s{number:0{len(name) - 1}}", f"127.1{a}.{b}.{10 + c}"
