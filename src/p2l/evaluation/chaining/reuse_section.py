"""Chapter 5: how recoveries get out of failures, where they reuse nominal skills, and what uncertainty changes."""

from __future__ import annotations

from collections.abc import Callable

import pandas as pd

from p2l.evaluation.chaining.figures import MAIN
from p2l.evaluation.chaining.readings import percent
from p2l.evaluation.chaining.reuse import ANY, novel_starts
from p2l.evaluation.chaining.views import CHAPTER, STAGE, absent_section, commands, joint_table, sheet
from p2l.evaluation.page.page import Agreement, Films, Part, Picture, Reading, Section
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.statistics import TRAININGS
from p2l.evaluation.style import png

COMMAND = "scripts/thesis_ablation.sh"
DEFINITION = (
    "A start is outside if its nearest neighbour among the states of successful nominal runs is farther away, in the "
    "world's features of failures, than that of 99 % of the states of other such runs; `visited` are all states in "
    "which the option is at work, `begun` those in which it starts."
)


def recovery_strategies(sources: Sources) -> Section:
    """By which strategy failures are recovered from."""
    title = "Section 5.4: recoveries by strategy"
    if not sources.chain_worlds:
        return absent_section(title)
    table = joint_table(sources, "strategies_5")
    if not len(table):
        return Section(title, ["Left out: no learner's recoveries were followed (reuse.learners)."])
    caption = f"share: of the recovered failures; recovery: of the failures on which it was tried. {TRAININGS}"
    return Section(title, [sheet("strategies_5", table, table, caption)], commands(sources))


def figure_5_9(sources: Sources) -> Section:
    """How often nominal options are started outside their nominal states, and how often that succeeds."""
    title = "Figure 5.9: novel reuse of nominal options"
    if not sources.chain_worlds:
        return absent_section(title)
    table, claim = joint_table(sources, "figure_5_9"), sources.chapter(CHAPTER).claims["figure_5_9", "novel"]
    if not len(table):
        return Section(title, ["Left out: no recovery of a failure has handed over to a nominal option."])
    parts: list[Part] = [DEFINITION, _novel(claim, table)]
    for place, world in enumerate(sources.chain_worlds):
        if table["setting"].str.startswith(f"world={world};").any():
            name = "figure_5_9" if place == 0 else f"figure_5_9_{world}"
            parts.append(Picture(name, png(novel_starts(table, world, MAIN)), f"{world}. {TRAININGS}"))
        films, reason = sources.videos(world, STAGE)
        entries = [
            (f"{world} reuse", mp4, f"{world}, the most novel start that paid: {one['told']}") for one, mp4 in films
        ]
        parts.append(Films(entries) if entries else f"{world}: no video, {reason}.")
    rows = table[table["metric"].str.endswith("_visited") & (table["n"] > 0)]
    parts.append(
        sheet("figure_5_9", rows, table, "Against the states in which an option is at work; others in the file.")
    )
    return Section(title, parts, commands(sources))


def ablation_5(sources: Sources) -> Section:
    """Policies trained under other state uncertainty, or from other observations."""
    title = "Section 5.4.2: ablation over state uncertainty and observations"
    if not sources.chain_worlds:
        return absent_section(title)
    found = [
        file.parent.name
        for world in sources.chain_worlds
        for file in sorted((sources.data / STAGE).glob(f"{world}_ablation*/ablation_5.csv"))
    ]
    tables = [sources.sheet(STAGE, one, "ablation_5.csv") for one in found]
    if not any(len(table) for table in tables):
        return Section(title, [f"Left out: {COMMAND} learns under other noise and has not been run here."])
    table = pd.concat(tables, ignore_index=True)
    caption = (
        "Success and recovery of policies learnt and judged in each variant; `primitives` before control is handed "
        f"back; `open_loop`: share of decisions that are the commonest at their number (1: one fixed sequence). "
        f"{TRAININGS}"
    )
    return Section(title, [sheet("ablation_5", table, table, caption)], [COMMAND])


SECTIONS: tuple[Callable[[Sources], Section], ...] = (recovery_strategies, figure_5_9, ablation_5)


def _novel(claim: str, table: pd.DataFrame) -> Reading:
    """Whether options are started outside nominal execution's states, and with success."""
    texts, verdicts = [], []
    for setting in dict.fromkeys(table["setting"]):
        world, option = (part.partition("=")[2] for part in setting.split(";"))
        mine = table[(table["setting"] == setting) & (table["method"] == MAIN)].set_index("metric").to_dict("index")
        outside, pays = mine.get("outside_visited"), mine.get("pays_outside_visited")
        if option != ANY or outside is None or pays is None or not outside["n"]:
            continue
        rest = f", of which {percent(pays)} end with the task done" if pays["n"] else ""
        texts.append(f"{world}: {percent(outside)} of the starts are outside{rest}")
        verdicts.append(bool(pays["n"]) and bool(pays["mean"] > 0.0))
    agrees: Agreement = "unsaid"
    if verdicts:
        agrees = "yes" if all(verdicts) else "partly" if any(verdicts) else "no"
    return Reading(claim, f"{'; '.join(texts)}." if texts else "No start of RC could be compared.", agrees)
