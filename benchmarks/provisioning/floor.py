"""The floor: one compiled script per robot over one paramiko connection each, all at once. Nothing is decided here.

    python floor.py up plan.json

plan.json holds `key`, `known_hosts`, and `robots`: name -> {address, user, script}. Host keys are checked strictly.
Prints one line per robot. Exit code 1 when a robot failed.
"""

import json
import socket
import sys
import threading

import paramiko


def do(name: str, robot: dict, key: paramiko.PKey, known: paramiko.HostKeys, answers: dict) -> None:
    try:
        plug = socket.create_connection((robot["address"], 22), timeout=20)
        plug.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        with paramiko.Transport(plug) as transport:
            expected = known.lookup(robot["address"])
            transport.get_security_options().key_types = [
                k for k in transport.get_security_options().key_types if expected and k in expected
            ]
            transport.start_client(timeout=20)
            shown = transport.get_remote_server_key()
            if not expected or expected.get(shown.get_name()) != shown:
                raise RuntimeError("host key is not the one in known_hosts")
            transport.auth_publickey(robot["user"], key)
            channel = transport.open_session(timeout=20)
            channel.settimeout(120)
            channel.set_combine_stderr(True)
            channel.exec_command(robot["script"])
            said = b"".join(iter(lambda: channel.recv(65536), b"")).decode(errors="replace").strip()
            answers[name] = (channel.recv_exit_status(), said or "right already")
    except Exception as error:  # a robot that fails does not stop the others
        answers[name] = (255, repr(error))


def main() -> None:
    with open(sys.argv[2], encoding="utf-8") as file:
        plan = json.load(file)
    key = paramiko.Ed25519Key.from_private_key_file(plan["key"])
    known = paramiko.HostKeys(plan["known_hosts"])
    answers = {}
    threads = [
        threading.Thread(target=do, args=(name, robot, key, known, answers)) for name, robot in plan["robots"].items()
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name, (code, said) in answers.items():
        print(name, code, said)
    sys.exit(any(code for code, _ in answers.values()))


if __name__ == "__main__" and sys.argv[1:2] == ["up"]:
    main()
