"""Write all that is made of the code into this checkout: python -m landerd.reference."""

from pathlib import Path

from landerd.reference.pages import pages

if __name__ == "__main__":
    checkout = Path(__file__).parents[2]
    for name, text in pages().items():
        path = checkout / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
            print(f"written: {name}")
